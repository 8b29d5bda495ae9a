"""Makes the OpenVDB files beside it with OpenVDB's own Python module (Debian: python3-openvdb), and what that module reads of
each grid's box of active voxels as NumPy arrays. Every value is exact in half precision, so that all forms hold the same."""

import numpy as np
import pyopenvdb as vdb

random = np.random.default_rng(7)


def grid(name, half, inactive):
    made = vdb.FloatGrid(0.0)
    made.name = name
    made.gridClass = vdb.GridClass.FOG_VOLUME
    made.saveFloatAsHalf = half
    made.fill((-8, 0, 8), (7, 7, 15), 0.25)  # whole leaves: tiles
    voxels = made.getAccessor()
    place = lambda: tuple(int(v) for v in random.integers((-10, 0, 2), (14, 16, 22)))
    for _ in range(300):
        voxels.setValueOn(place(), float(np.float16(random.random())))
    for value in inactive:
        for _ in range(5):
            voxels.setValueOff(place(), value)
    made.transform = vdb.createLinearTransform(voxelSize=25.0)
    made.transform.translate((100.0, -50.0, 700.0))
    return made


files = {
    "float": [grid("density", False, [])],
    "half": [grid("density", True, [])],
    "inactive": [grid("one", False, [0.5]), grid("two", True, [0.5, 2.0]), grid("many", False, [0.5, 2.0, 3.0, 4.0])],
}
for name, grids in files.items():
    vdb.write(f"{name}.vdb", grids=grids)
    for read in vdb.readAll(f"{name}.vdb")[0]:
        low, high = read.evalActiveVoxelBoundingBox()
        dense = np.zeros(tuple(b - a + 1 for a, b in zip(low, high)), np.float32)
        read.copyToArray(dense, low)
        half = dense.astype(np.float16)
        assert (half == dense).all()
        np.save(f"{name}.{read.name}.npy", half)
        print(name, read.name, low, high)
# What is refused: a level set, and a grid of another type beside it.
sphere = vdb.createLevelSetSphere(radius=3.0, center=(20.0, 20.0, 20.0))
sphere.name = "surface"
wind = vdb.Vec3SGrid((0.0, 0.0, 0.0))
wind.name = "wind"
wind.fill((0, 0, 0), (2, 2, 2), (1.0, 0.0, 0.0))
vdb.write("refused.vdb", grids=[sphere, wind])
