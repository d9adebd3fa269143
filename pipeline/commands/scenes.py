"""Commands that make scenes: `scan`, `repair`."""

from ...formats.core.errors import InputError
from ..context import run_single
from ..inputs.builtin import BuiltIn, check_kind
from ..inputs.folders import refuse_to_replace
from ..options.scenes import Repair, Scan
from ..stages.scenes import items as repair
from ..summary import print_result

SCAN_NAMES = frozenset({"scan.glb", "scan.ply", "scan.labels.json", "truth.npz", "LICENSE.scan"})
SCENE_NAMES = frozenset(
    {"scene.json", "scene.usdc", "visual.npz", "textures", "levels", "splats.npz"}
    | {"repair.json", "before.png", "after.png"}
)


def run_scan(options: Scan) -> int:
    """Generate one scan."""
    check_kind(options.kind)
    refuse_to_replace(options.out, SCAN_NAMES)
    out = options.out.resolve()
    if options.exact and options.splats:
        raise InputError(
            "--exact and --splats cannot be combined: splats are a virtual capture; choose one"
        )
    building = BuiltIn(options.kind, options.seed, not options.exact)
    item = repair.scan_item(building, out, options.splats)
    facts = run_single(out, repair.SCAN_STAGE, item).facts
    return print_result(
        options, facts, f"{options.out / facts['scan']}: {options.kind} {options.seed}"
    )


def run_repair(options: Repair) -> int:
    """Repair one scan and print the decisions made; return 1 if the scene is not sound."""
    out = options.out.resolve()
    collision = str(options.collision.resolve()) if options.collision else ""
    # Later commands find a scene by its folder's name, and every generated scan is a scan.glb.
    config = options.repair_config(scene_id=out.name, collision=collision)
    item = repair.item(options.scan, out, config)
    refuse_to_replace(options.out, SCENE_NAMES)
    facts = run_single(out, repair.STAGE, item).facts
    end = "repaired" if facts["sound"] else "repaired, but NOT SOUND (collect refuses it)"
    lines = [
        *repair.decisions(facts),
        f"{options.out}: {end}; see repair.json, before.png, after.png",
    ]
    print_result(options, facts, "\n".join(lines))
    return int(not facts["sound"] and not options.allow_unsound)
