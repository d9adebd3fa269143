"""The SceneBundle: a repaired scene on disk, ready for physics, planning and rendering.

    <scene>/
      scene.json            index: source, licence, transform, materials, labels, levels
      scene.usdc            the same scene for USD readers
      visual.npz            triangles with texture coordinates, materials and labels
      textures/*            images named by the materials
      levels/<k>/floor.npz      floor heights (MuJoCo height field) and coverage
      levels/<k>/obstacles.npz  boxes
      levels/<k>/freemap.npz    planning map inputs
      stairs/<k>/*.npz          the same of each climbable staircase, and treads.npz, its boxes
      repair.json, before.png, after.png

The index is written last: a folder with one is complete.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import F32, I32, Array
from ..core.atomic import write_json
from ..core.errors import FileFormatError, brief
from ..untrusted.documents import read_json_object
from ..untrusted.files import is_relative
from .arrays import known_fields, record_of, save_npz
from .freemap import Freemap
from .sheet import Floor, Obstacles, read_floor, read_freemap, read_obstacles, save_sheet
from .staircase import Staircase, Treads

INDEX_NAME = "scene.json"
FORMAT_VERSION = 1


@dataclass(frozen=True)
class Material:
    """Material: base colour (sRGB, 0–1) times an optional texture, a path in the bundle."""

    name: str
    base_color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    texture: str | None = None


@dataclass(frozen=True)
class VisualMesh:
    """Triangles as they are rendered, double-sided.

    Attributes:
        vertices: (V, 3) float32 [m], world.
        faces: (F, 3) int32.
        corner_uv: (F, 3, 2) float32; v up, (0, 0) = the texture's lower left corner.
        face_material: (F,) int32 index into the bundle's materials.
        face_label: (F,) int32 index into the bundle's labels, −1 = unlabelled.
        face_object: (F,) int32 index into the bundle's objects, −1 = of no named thing; left out,
            as in bundles written before there were instances, all are −1.
    """

    vertices: F32
    faces: I32
    corner_uv: F32
    face_material: I32
    face_label: I32
    face_object: I32 = field(default_factory=lambda: np.empty(0, dtype=np.int32))

    def __post_init__(self) -> None:
        if not len(self.face_object) and len(self.faces):
            object.__setattr__(self, "face_object", np.full(len(self.faces), -1, dtype=np.int32))


@dataclass(frozen=True)
class LabeledObject:
    """A named object in the scene, for landmarks and semantics.

    Attributes:
        name: unique, e.g. `Sofa_1`.
        category: e.g. `sofa`; rooms use the category `room:<kind>`, e.g. `room:kitchen`.
        lower_m, upper_m: (3,) axis-aligned bounds, world [m].
        level: index of the level it stands on, −1 = unknown.
    """

    name: str
    category: str
    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]
    level: int = -1


@dataclass(frozen=True)
class SceneBundle:
    """A repaired scene; heavy arrays are loaded when asked for.

    Attributes:
        source: `path`, `sha256`, `licence`, evidence of up-axis and unit, and under `UNSOUND` what
            is wrong with a scene that should not be used, as JSON values.
        source_to_world: (4, 4) similarity from the source file's coordinates to world.
        habitat_to_world: (4, 4) rigid transform to world from Habitat coordinates of the source
            (y up), i.e. including the recorded levelling; identity levelling gives (x, −z, y).
        materials, labels, objects: see their records; labels are category names.
        level_floor_z_m: median floor height of each level, lowest first.
        generator: facts of a generated scene (seed, …); empty for a scan.
        staircases: between its levels; their index counts those that nobody can climb, too.
    """

    root: Path
    scene_id: str
    source: dict[str, Any]
    source_to_world: Array
    habitat_to_world: Array
    materials: tuple[Material, ...]
    labels: tuple[str, ...]
    objects: tuple[LabeledObject, ...]
    level_floor_z_m: tuple[float, ...]
    generator: dict[str, Any] = field(default_factory=dict)
    staircases: tuple[Staircase, ...] = ()

    def visual(self) -> VisualMesh:
        """Load the visual mesh; bundles without `face_object` give −1 for every face."""
        path = self.root / "visual.npz"
        return record_of(path, lambda data: VisualMesh(**known_fields(VisualMesh, data)))

    def level_folder(self, level: int) -> Path:
        """Return the folder of a level.

        Raises:
            ValueError: no such level; the message says how many there are.
        """
        if not 0 <= level < len(self.level_floor_z_m):
            count = len(self.level_floor_z_m)
            raise ValueError(f"level {level} of {self.scene_id}; valid: 0 … {count - 1}")
        return self.root / "levels" / str(level)

    def stair_folder(self, staircase: int) -> Path:
        """Return the folder of a climbable staircase.

        Raises:
            ValueError: no such staircase, or nobody can climb it; the message says why.
        """
        if not 0 <= staircase < len(self.staircases):
            count = len(self.staircases)
            valid = f"0 … {count - 1}" if count else "none, it has no staircases"
            raise ValueError(f"staircase {staircase} of {self.scene_id}; valid: {valid}")
        if problem := self.staircases[staircase].problem:
            raise ValueError(f"staircase {staircase} of {self.scene_id} {problem}")
        return self.root / "stairs" / str(staircase)

    def floor(self, level: int) -> Floor:
        """Load a level's floor."""
        return read_floor(self.level_folder(level))

    def obstacles(self, level: int) -> Obstacles:
        """Load a level's collision boxes."""
        return read_obstacles(self.level_folder(level))

    def freemap(self, level: int) -> Freemap:
        """Load a level's planning map."""
        return read_freemap(self.level_folder(level))

    def stair_floor(self, staircase: int) -> Floor:
        """Load the floor of a staircase: treads, landings, and floor of both levels at its ends."""
        return read_floor(self.stair_folder(staircase))

    def stair_obstacles(self, staircase: int) -> Obstacles:
        """Load the collision boxes over and beside a staircase."""
        return read_obstacles(self.stair_folder(staircase))

    def stair_freemap(self, staircase: int) -> Freemap:
        """Load the planning map of a staircase."""
        return read_freemap(self.stair_folder(staircase))

    def stair_treads(self, staircase: int) -> Treads:
        """Load the boxes that a staircase consists of."""
        path = self.stair_folder(staircase) / "treads.npz"
        return record_of(path, lambda data: Treads(**known_fields(Treads, data)))


def save_bundle(
    bundle: SceneBundle,
    visual: VisualMesh,
    levels: list[tuple[Floor, Obstacles, Freemap]],
    stairs: Mapping[int, tuple[Floor, Obstacles, Freemap, Treads]] | None = None,
) -> None:
    """Write `bundle` and its arrays under `bundle.root`; the index goes last.

    Args:
        stairs: what each climbable staircase consists of, by its index.
    """
    save_npz(bundle.root / "visual.npz", **vars(visual))
    for k, level in enumerate(levels):
        save_sheet(bundle.level_folder(k), *level)
    for k, (floor, obstacles, freemap, treads) in (stairs or {}).items():
        save_sheet(bundle.stair_folder(k), floor, obstacles, freemap)
        save_npz(bundle.stair_folder(k) / "treads.npz", **vars(treads))
    save_index(bundle)


def save_index(bundle: SceneBundle) -> None:
    """Write the bundle's index, which goes last: a folder with one is complete."""
    write_json(
        bundle.root / INDEX_NAME,
        {
            "format_version": FORMAT_VERSION,
            "scene_id": bundle.scene_id,
            "source": bundle.source,
            "source_to_world": bundle.source_to_world.tolist(),
            "habitat_to_world": bundle.habitat_to_world.tolist(),
            "materials": [asdict(m) for m in bundle.materials],
            "labels": list(bundle.labels),
            "objects": [asdict(o) for o in bundle.objects],
            "level_floor_z_m": list(bundle.level_floor_z_m),
            "generator": bundle.generator,
            "staircases": [s.as_json() for s in bundle.staircases],
        },
    )


def load_bundle(root: Path) -> SceneBundle:
    """Open the bundle in folder `root`."""
    path = root / INDEX_NAME
    if not path.is_file():
        raise FileFormatError(root, f"contains no repaired scene ({INDEX_NAME} is missing)")
    try:
        index = read_json_object(path)
        textures = [material["texture"] for material in index["materials"]]
        for texture in filter(None, textures):
            if not is_relative(texture):
                reason = f"texture {brief(texture)} leads out of the scene's folder"
                raise FileFormatError(path, reason)
        if (version := index["format_version"]) != FORMAT_VERSION:
            reason = f"format version {version}; this code reads {FORMAT_VERSION}"
            raise FileFormatError(path, reason)
        return SceneBundle(
            root=root,
            scene_id=index["scene_id"],
            source=index["source"],
            source_to_world=np.array(index["source_to_world"], dtype=np.float64),
            habitat_to_world=np.array(index["habitat_to_world"], dtype=np.float64),
            materials=tuple(
                Material(m["name"], tuple(m["base_color"]), m["texture"])
                for m in index["materials"]
            ),
            labels=tuple(index["labels"]),
            objects=tuple(
                LabeledObject(
                    o["name"], o["category"], tuple(o["lower_m"]), tuple(o["upper_m"]), o["level"]
                )
                for o in index["objects"]
            ),
            level_floor_z_m=tuple(index["level_floor_z_m"]),
            generator=index["generator"],
            staircases=tuple(
                # Scenes repaired before there were staircases have no such key.
                Staircase.from_json(values, len(index["level_floor_z_m"]))
                for values in index.get("staircases", ())
            ),
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise FileFormatError(path, f"not a scene index: {error!r}") from error
