"""Runs with pytest, or by itself."""

import doctest
import pathlib

import numpy as np
import squall

GOLDEN = pathlib.Path(__file__).parents[3] / "data" / "golden" / "v1" / "golden.squall"


def scene(dtype=np.uint8):
    height, width = 90, 120
    ramp = np.linspace(0.1, 0.9, width, dtype=np.float32)
    light = np.repeat(np.tile(ramp, (height, 1))[:, :, None], 3, axis=2)
    depth = np.full((height, width), 30.0, dtype=np.float32)
    depth[:, : width // 2] = 0.4
    if dtype is np.float32:
        return light, depth
    return (light * np.iinfo(dtype).max).astype(dtype), depth


def rained(rgb, depth, **changes):
    settings = dict(rate=80, vertical_fov=60, streak_px=(6, 200), gain=2.0)
    settings.update(changes)
    return squall.rain(rgb, depth, **settings)


def refused(words, **changes):
    rgb, depth = scene()
    try:
        rained(changes.pop("rgb", rgb), changes.pop("depth", depth), **changes)
    except ValueError as error:
        assert words in str(error), str(error)
    else:
        raise AssertionError("no error that says " + words)


def test_the_result_has_the_type_that_came_and_inputs_stay_as_they_are():
    for dtype in (np.uint8, np.uint16, np.float32):
        rgb, depth = scene(dtype)
        before = rgb.copy(), depth.copy()
        result = rained(rgb, depth)
        assert result.image.dtype == dtype and result.image.shape == rgb.shape
        assert not np.array_equal(result.image, rgb)
        assert np.array_equal(rgb, before[0]) and np.array_equal(depth, before[1])
        assert result.mask.shape == depth.shape and 0 <= result.mask.min() <= result.mask.max() <= 1


def test_the_same_call_gives_the_same_bytes_and_another_seed_another_rain():
    rgb, depth = scene()
    first = rained(rgb, depth)
    assert np.array_equal(first.image, rained(rgb, depth).image)
    assert not np.array_equal(first.image, rained(rgb, depth, seed=2).image)


def test_no_rain_changes_nothing_in_any_type():
    for dtype in (np.uint8, np.uint16, np.float32):
        rgb, depth = scene(dtype)
        assert np.array_equal(rained(rgb, depth, rate=0).image, rgb)


def test_what_is_near_hides_the_rain():
    rgb, depth = scene()
    mask = rained(rgb, depth).mask
    half = mask.shape[1] // 2
    assert mask[:, : half - 4].sum() < 0.7 * mask[:, half + 4 :].sum()


def test_every_type_layout_and_kind_of_depth_is_the_same_scene():
    rgb, depth = scene()
    depth[:, :60], depth[:, 60:] = 0.5, 32.0
    wanted = rained(rgb, depth).image
    focal = 45 / np.tan(np.radians(30))
    disparity = (0.5 * focal / depth).astype(np.float64)
    for other, changes in [
        (depth.astype(np.float64), {}),
        (np.asfortranarray(depth), {}),
        (depth[::-1][::-1], {}),
        ((depth * 256).astype(np.uint16), dict(depth_scale=256)),
        (depth * 1000, dict(depth_scale=0.001)),
    ]:
        assert np.array_equal(rained(rgb, other, **changes).image, wanted)
    close = rained(rgb, disparity, depth_kind="disparity", baseline=0.5).image
    assert np.abs(close.astype(int) - wanted).max() <= 1
    assert np.array_equal(rained(rgb[:, ::-1][:, ::-1], depth).image, wanted)


def test_a_pair_sees_the_same_drops_at_the_disparity_of_their_depth():
    rgb, depth = scene()
    depth[:] = np.inf
    lens = (100.0, 100.0, 59.5, 44.5)
    pose = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1.6], [0, 0, 0, 1]], dtype=float)
    moved = pose.copy()
    moved[0, 3] = 0.5
    both = dict(vertical_fov=None, intrinsics=lens)
    left = rained(rgb, depth, pose=pose, **both)
    right = rained(rgb, depth, pose=moved, light=left.light, **both)
    _, a, b = np.intersect1d(left.streaks["id"], right.streaks["id"], return_indices=True)
    assert len(a) > 50
    shift = left.streaks["ends_px"][a, 0, 0] - right.streaks["ends_px"][b, 0, 0]
    assert np.allclose(shift, 100.0 * 0.5 / left.streaks["depth_m"][a], atol=1e-3, rtol=1e-5)
    assert np.array_equal(left.light.coefficients(), right.light.coefficients())
    again = squall.Light.from_coefficients(left.light.coefficients().tolist())
    assert np.array_equal(again.coefficients(), left.light.coefficients())


def test_what_is_wrong_is_a_value_error_that_says_so():
    rgb, depth = scene()
    refused("depth_scale", depth=(depth * 256).astype(np.uint16))
    refused("shape (90, 120)", depth=depth[:10])
    refused("uint8, uint16", rgb=rgb.astype(np.int32))
    refused("shape (height, width, 3)", rgb=rgb[:, :, :2])
    refused("200 mm/h", rate=900)
    refused("either intrinsics or vertical_fov", vertical_fov=None)
    refused("'planar', 'ray'", depth_kind="z")
    refused("baseline", depth_kind="disparity")
    for baseline in (-0.5, 0.0, float("nan"), float("inf")):
        refused("baseline: wanted metres above 0", depth_kind="disparity", baseline=baseline)
    refused("rotation", pose=np.zeros((4, 4)).tolist())
    refused("gain", gain=-1.0)
    try:
        squall.open("none.squall")
    except FileNotFoundError as error:
        assert "none.squall" in str(error)


def test_a_storm_is_drawn_and_developed():
    storm = squall.open(GOLDEN)
    width, height = storm.size
    picture = storm.render()
    assert picture.shape == (height, width, 3) and picture.dtype == np.float32 and picture.max() > 0
    assert storm.develop(picture).dtype == np.uint8
    dark = storm.render(flashes={})
    assert dark.sum() < picture.sum()
    assert storm.render(size=(32, 18)).shape == (18, 32, 3)


def test_the_docstrings_example_runs():
    assert doctest.testmod(squall).failed == 0


if __name__ == "__main__":
    for name, test in list(globals().items()):
        if name.startswith("test_"):
            test()
            print(name, "ok")
