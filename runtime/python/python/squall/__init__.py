"""Rain over your own frames, and pictures of baked storms.

>>> import numpy, squall
>>> rgb = numpy.full((120, 160, 3), 90, dtype=numpy.uint8)
>>> depth = numpy.full((120, 160), 20.0, dtype=numpy.float32)
>>> rained = squall.rain(rgb, depth, rate=50, vertical_fov=60)
>>> rained.image.shape, rained.image.dtype
((120, 160, 3), dtype('uint8'))
>>> bool(0 < rained.mask.mean() < 1)
True
>>> again = squall.rain(rgb, depth, rate=50, vertical_fov=60)
>>> bool((again.image == rained.image).all())
True
"""

from ._squall import Light, Rain, Rained, Storm, __version__, open

__all__ = ["Light", "Rain", "Rained", "Storm", "open", "rain", "__version__"]

_built_in = None


def rain(rgb, depth, *, asset=None, **settings):
    """Puts rain over a frame and returns a `Rained`: the rainy image, its labels and its streaks. `rgb` and `depth` are not changed.

    rgb: array (height, width, 3); uint8 and uint16 are sRGB, float32 is linear light. The result has the same type.
    depth: array (height, width); float32 or float64 in metres times `depth_scale`, or uint16 with `depth_scale` steps a metre (KITTI
        256, TUM 5000). Infinity is sky; 0, negative numbers and NaN are holes.
    rate: rainfall intensity, mm/h.
    intrinsics: (fx, fy, cx, cy) in pixels, (0, 0) the middle of the top left pixel; or vertical_fov in degrees.
    exposure_ms, time (s), seed, wind (x, y, z in m/s), gain (1 is physical).
    pose: 4 × 4, from a camera (x right, y down, z ahead) to a world whose z is up; level without. velocity of the camera, m/s.
    light: a `Light`, such as `rained.light` of the sequence's first frame; estimated from this frame without.
    depth_kind: 'planar', 'ray' or 'disparity' (with `baseline` in m). holes: 'fill', 'leave' or 'sky'.
    sky_distance: how far the rain reaches, m. streak_px: (shortest, longest) streak drawn.
    asset: path of an asset whose tables and patterns to use; `Rain(asset)` keeps them for many frames.
    """
    global _built_in
    if asset is not None:
        return Rain(asset).rain(rgb, depth, **settings)
    if _built_in is None:
        _built_in = Rain()
    return _built_in.rain(rgb, depth, **settings)
