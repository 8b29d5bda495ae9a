from os import PathLike
from typing import Any, Literal, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

__version__: str

_Path = Union[str, "PathLike[str]"]
_Kind = Literal["planar", "ray", "disparity"]
_Holes = Literal["fill", "leave", "sky"]

class Light:
    def coefficients(self) -> npt.NDArray[np.float32]: ...
    @staticmethod
    def from_coefficients(coefficients: Sequence[Sequence[float]]) -> Light: ...
    @staticmethod
    def uniform(radiance: Sequence[float]) -> Light: ...

class Rained:
    @property
    def image(self) -> npt.NDArray[Any]: ...
    @property
    def mask(self) -> npt.NDArray[np.float32]: ...
    @property
    def transmittance(self) -> npt.NDArray[np.float32]: ...
    @property
    def in_scattered(self) -> npt.NDArray[np.float32]: ...
    @property
    def streaks(self) -> dict[str, npt.NDArray[Any]]: ...
    @property
    def light(self) -> Light: ...
    @property
    def holes(self) -> int: ...

class Rain:
    def __init__(self, asset: Optional[_Path] = None) -> None: ...
    def rain(
        self,
        rgb: npt.NDArray[Any],
        depth: npt.NDArray[Any],
        *,
        rate: float,
        intrinsics: Optional[Sequence[float]] = None,
        vertical_fov: Optional[float] = None,
        exposure_ms: float = 20.0,
        time: float = 0.0,
        seed: int = 1,
        wind: Sequence[float] = (0.0, 0.0, 0.0),
        pose: Optional[Sequence[Sequence[float]]] = None,
        velocity: Sequence[float] = (0.0, 0.0, 0.0),
        light: Optional[Light] = None,
        gain: float = 1.0,
        depth_kind: _Kind = "planar",
        depth_scale: Optional[float] = None,
        baseline: Optional[float] = None,
        holes: _Holes = "fill",
        sky_distance: float = 1000.0,
        streak_px: Optional[Sequence[float]] = None,
    ) -> Rained: ...

class Storm:
    @property
    def strokes(self) -> list[str]: ...
    @property
    def size(self) -> Optional[Tuple[int, int]]: ...
    def render(
        self,
        *,
        rate: Optional[float] = None,
        time: Optional[float] = None,
        exposure_ms: Optional[float] = None,
        flashes: Optional[Mapping[str, float]] = None,
        size: Optional[Sequence[int]] = None,
        samples: int = 2,
    ) -> npt.NDArray[np.float32]: ...
    def develop(self, radiance: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]: ...
    @staticmethod
    def flash_curve(seed: int, opens: Sequence[float], exposure: float) -> list[float]: ...

def open(path: _Path) -> Storm: ...
def rain(
    rgb: npt.NDArray[Any],
    depth: npt.NDArray[Any],
    *,
    rate: float,
    asset: Optional[_Path] = None,
    intrinsics: Optional[Sequence[float]] = None,
    vertical_fov: Optional[float] = None,
    exposure_ms: float = 20.0,
    time: float = 0.0,
    seed: int = 1,
    wind: Sequence[float] = (0.0, 0.0, 0.0),
    pose: Optional[Sequence[Sequence[float]]] = None,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
    light: Optional[Light] = None,
    gain: float = 1.0,
    depth_kind: _Kind = "planar",
    depth_scale: Optional[float] = None,
    baseline: Optional[float] = None,
    holes: _Holes = "fill",
    sky_distance: float = 1000.0,
    streak_px: Optional[Sequence[float]] = None,
) -> Rained: ...
