"""Judge the probes of a level: faults that make a scene unsound, and doubts."""

from dataclasses import dataclass, field
from typing import Any

# Gaps of a kind that together are smaller than this, and than this share of the floor where that is
# more, are a doubt: cells above them are taken out of the maps, so no robot is sent there.
DOUBT_M2, DOUBT_SHARE, MOST_DOUBT_M2 = 0.05, 0.001, 0.5
OPEN_SHARE = 0.5  # of the walkable floor; courtyards and gaps in ceilings are smaller
LOOK = "look at after.png there; scan that place again, or close it, if robots are to walk on it"


@dataclass
class Verdict:
    """Faults that make a scene unsound, and doubts too small for that; one line each."""

    faults: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def judge_level(level: dict[str, Any], probes: dict[str, Any]) -> Verdict:
    """Judge a level's entry of `verify_scene`, and its `probes` in `repair.json`."""
    verdict = Verdict()
    limit = min(max(DOUBT_M2, DOUBT_SHARE * level["floor_area_m2"]), MOST_DOUBT_M2)

    def judge(text: str, area_m2: float) -> None:
        (verdict.faults if area_m2 > limit else verdict.doubts).append(text)

    places = probes.get("walkable_places_lost", [])
    if places:
        area, first = sum(p["area_m2"] for p in places), places[0]
        judge(
            f"{probes['walkable_cells_lost']} walkable cells lost their floor and left the maps: "
            f"{counted(len(places), 'place')}, {area:.3f} m² together, the largest of "
            f"{first['area_m2']:.3f} m² {_at(first['xy_m'])}; {LOOK}",
            area,
        )
    if (share := probes.get("open_sky_share", 0.0)) > OPEN_SHARE:
        verdict.doubts.append(
            f"{100 * share:.0f} % of the walkable floor has no ceiling: depth that meets nothing "
            "reads 0 m, which misleads policies trained under ceilings; --ceiling HEIGHT lays one, "
            "best where the walls end"
        )
    for kind in ("rays", "balls"):
        for name, result in level[kind].items():
            if result["fell_through"]:
                verdict.faults.append(
                    f"{result['fell_through']} of {result['dropped']} {kind} fall through the "
                    f"floor in {name}, the first {_at(result['where_xy_m'][0])}"
                )
    if level["steps_by_repair"]:
        step = next(s for s in level["steps_over_15_mm"] if s["origin"] == "repair")
        count = counted(level["steps_by_repair"], "step")
        verdict.faults.append(
            f"{count} over 15 mm that the scan does not have, the highest of "
            f"{1000 * step['height_m']:.0f} mm {_at(step['lower_xy_m'])}"
        )
    for key, size, text in (
        ("holes_still_open", "open_area_m2", "hole listed as filled is open in part"),
        ("holes_unlisted", "area_m2", "gap of 5 cm or more is on no list"),
    ):
        gaps = sorted(level[key], key=lambda gap: -gap[size])
        if gaps:
            area = sum(gap[size] for gap in gaps)
            count = f"{len(gaps)} times: a {text}" if len(gaps) > 1 else f"a {text}"
            judge(
                f"{count}, {area:.4f} m² together, the largest of {gaps[0][size]:.4f} m² "
                f"{_at(gaps[0]['xy_m'])}; {LOOK}",
                area,
            )
    if level["holes_left_without_reason"]:
        verdict.faults.append(
            f"holes {level['holes_left_without_reason']} are left without a reason"
        )
    return verdict


def _at(xy_m: list[float]) -> str:
    return f"at x {xy_m[0]}, y {xy_m[1]}"


def counted(count: int, what: str) -> str:
    """Return a number of things in words."""
    return f"1 {what}" if count == 1 else f"{count} {what}s"
