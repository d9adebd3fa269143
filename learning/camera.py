"""The camera that a selection's images were taken with."""

from collections.abc import Sequence
from dataclasses import replace

import pyarrow.parquet as pq

from ..datasets.episode_index import DatasetIndex, episode_tables
from ..datasets.selection import Selection
from ..formats.core.errors import InputError
from ..formats.lerobot.layout import DEPTH_KEY
from ..rendering.camera.rigs import is_rig
from .card import View

_ALL_DEPTH_M = 1e6  # images of millimetres have no far end
_ONE_FOV_DEG = 0.5  # a calibrated camera never has the field of view that was asked of a renderer
_COLUMNS = ("camera_width_px", "camera_height_px", "camera_hfov_deg", "camera_name")


def view_of(selections: Sequence[Selection]) -> View:
    """Return the one camera of all selections; where they differ, a model has no single camera.

    Raises:
        InputError: Their sizes, fields of view (by over 0.5°) or ranges of depth differ.
    """
    views = {
        view
        for selection in selections
        for number in sorted(set(selection.dataset.tolist()))
        for view in _views(selection.datasets[number])
    }
    if len({view.mount for view in views}) > 1:
        views = {replace(view, mount=View.mount) for view in views}
    widest_deg = max((view.hfov_deg for view in views), default=0.0)
    views = {
        replace(view, hfov_deg=widest_deg) if widest_deg - view.hfov_deg <= _ONE_FOV_DEG else view
        for view in views
    }
    if len(views) != 1:
        sizes = "; ".join(
            sorted(
                f"{v.width_px}x{v.height_px}:{v.hfov_deg:g} to {v.depth_far_m:g} m" for v in views
            )
        )
        raise InputError(
            f"the datasets have several cameras ({sizes}); choose one of them with the sources' "
            "`data`, because a policy is evaluated with one"
        )
    return views.pop()


def _views(index: DatasetIndex) -> set[View]:
    info = index.info["features"].get(DEPTH_KEY, {}).get("info", {})
    far_m = float(info.get("video.depth_max", _ALL_DEPTH_M))
    rows = set()
    for path in episode_tables(index.root):
        schema = pq.read_schema(path)
        missing = [name for name in _COLUMNS if name not in schema.names]
        if missing:
            raise InputError(
                f"{index.root}: its episodes lack {', '.join(missing)}; `vlnpe restore` gives "
                "edited datasets their columns back"
            )
        table = pq.read_table(path, columns=list(_COLUMNS)).to_pydict()
        rows |= set(zip(*(table[name] for name in _COLUMNS), strict=True))
    return {
        View(int(w), int(h), float(fov), far_m, name if is_rig(name) else View.mount)
        for w, h, fov, name in rows
    }
