"""Options of the generated buildings and of their virtual scans."""

from dataclasses import dataclass, field, replace

from ..formats.core.errors import check_name


@dataclass(frozen=True)
class ScanConfig:
    """Options of a virtual scan and of its textures.

    Attributes:
        voxel_m: side of a fusion voxel.
        view_px, view_hfov_deg: width and height of a depth view, and its horizontal field of view.
        station_spacing_m: distance between the places where the scanner stops.
        noise_m, noise_per_m2: standard deviation of a depth reading at distance d is
            `noise_m + noise_per_m2 * d²`.
        pose_noise_m, pose_noise_deg: standard deviation of the error of each view's pose.
        target_faces: the fused mesh is decimated to about so many triangles.
        texel_m, floor_texel_m: side of a texel on walls and furniture, and on floors.
        page_px, jpeg_quality: largest side of a texture page, and its quality in the file.
        light_rays: hemisphere rays per point of the baked light.
    """

    voxel_m: float = 0.03
    view_px: tuple[int, int] = (256, 192)
    view_hfov_deg: float = 92.0
    station_spacing_m: float = 1.25
    noise_m: float = 0.0015
    noise_per_m2: float = 0.0018
    pose_noise_m: float = 0.003
    pose_noise_deg: float = 0.12
    target_faces: int = 240_000
    texel_m: float = 0.007
    floor_texel_m: float = 0.005
    page_px: int = 4096
    jpeg_quality: int = 90
    light_rays: int = 48


@dataclass(frozen=True)
class StairsConfig:
    """Options of a house's stairs.

    Attributes:
        shape: `straight`, `L` or `U`.
        riser_m, tread_m: least and greatest height and depth of a step.
    """

    shape: str = "U"
    riser_m: tuple[float, float] = (0.175, 0.175)
    tread_m: tuple[float, float] = (0.26, 0.26)


@dataclass(frozen=True)
class ApartmentConfig:
    """Options of a building and its scan; the defaults are those of an apartment.

    Attributes:
        kind: `apartment`, `villa`, `house` or `office`.
        area_m2: least and greatest floor area, of all storeys together.
        rooms: least and greatest number of rooms, hallways included; apartments ignore it.
        door_width_m: least and greatest clear width of a doorway; `door_height_m` its height.
        ceiling_m: least and greatest room height.
        wall_m: thickness of a wall.
        stairs: of a house.
        robot_radius_m: every room is reachable for a disc of this radius.
        scan_tilt_deg: the scanner's vertical leans by this angle about world x.
        scan_offset_m: the scanner's origin lies here in world coordinates.
    """

    kind: str = "apartment"
    area_m2: tuple[float, float] = (82.0, 135.0)
    rooms: tuple[int, int] = (4, 9)
    door_width_m: tuple[float, float] = (0.9, 1.0)
    door_height_m: float = 2.05
    ceiling_m: tuple[float, float] = (2.5, 2.8)
    wall_m: float = 0.12
    stairs: StairsConfig = StairsConfig()
    robot_radius_m: float = 0.35
    scan_tilt_deg: float = 0.0
    scan_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scan: ScanConfig = field(default_factory=ScanConfig)


# Larger buildings get more triangles, and texels that keep a floor on one texture page.
_LARGE_SCAN = ScanConfig(station_spacing_m=1.5, target_faces=420_000, floor_texel_m=0.006)
BUILDINGS: dict[str, ApartmentConfig] = {
    "apartment": ApartmentConfig(),
    "villa": ApartmentConfig(kind="villa", area_m2=(180.0, 300.0), rooms=(8, 12), scan=_LARGE_SCAN),
    "house": ApartmentConfig(
        kind="house", area_m2=(170.0, 290.0), rooms=(11, 16), scan=_LARGE_SCAN
    ),
    "office": ApartmentConfig(
        kind="office",
        area_m2=(300.0, 600.0),
        rooms=(8, 14),
        ceiling_m=(2.8, 3.2),
        scan=replace(
            _LARGE_SCAN,
            voxel_m=0.035,
            station_spacing_m=1.8,
            target_faces=500_000,
            texel_m=0.009,
            floor_texel_m=0.008,
        ),
    ),
}


# The shape of a house's stairs by the last digit of its seed; with other digits, houses are what
# they were when all stairs were alike.
STAIRS_BY_DIGIT = {5: "straight", 6: "L", 7: "U", 8: "straight", 9: "L"}
_DRAWN_STEPS_M = {"riser_m": (0.15, 0.19), "tread_m": (0.25, 0.30)}


def building_config(kind: str, seed: int = 0) -> ApartmentConfig:
    """Return the configuration of a kind of building; the seed determines a house's stairs.

    Raises:
        UnknownNameError: there is no such kind.
    """
    check_name("kind of building", kind, BUILDINGS)
    config, shape = BUILDINGS[kind], STAIRS_BY_DIGIT.get(seed % 10)
    if kind != "house" or shape is None:
        return config
    return replace(config, stairs=StairsConfig(shape, **_DRAWN_STEPS_M))
