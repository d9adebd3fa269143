"""Names of built-in scenes."""

from pathlib import Path

import pytest

from vlnpe.apartments import BUILDINGS
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.collect.command import Collect, run, sources_of
from vlnpe.pipeline.inputs.builtin import BuiltIn, parse_builtin
from vlnpe.pipeline.stages.scenes import items as scene_items


def names(text: str, seed: int = 0) -> list[str]:
    return [building.name for building in parse_builtin(text, seed)]


def test_builtin_alone_is_the_apartment_of_the_seed() -> None:
    assert parse_builtin("builtin", 7) == [BuiltIn("apartment", 7)]
    assert names("builtin", 7) == ["apartment-7"]


@pytest.mark.parametrize("kind", sorted(BUILDINGS))
def test_every_kind_has_a_name(kind: str) -> None:
    assert names(f"builtin:{kind}", 3) == [f"{kind}-3"]


def test_ten_villas_are_distinct_and_keep_their_names() -> None:
    ten = names("builtin:villa*10", 4)
    assert ten == [f"villa-{seed}" for seed in range(4, 14)]
    # A villa has the same name whatever run asks for it.
    assert set(names("builtin:villa*3", 6)) < set(ten)
    assert names("builtin*2") == ["apartment-0", "apartment-1"]


def test_exact_buildings_are_scenes_of_their_own() -> None:
    (exact,) = parse_builtin("builtin-exact:villa", 3)
    assert exact == BuiltIn("villa", 3, scanned=False)
    assert exact.name == "exact-villa-3"
    assert names("builtin-exact") == ["exact-apartment-0"]
    keys = {scene_items.scan_item(b, Path("x")).key for b in (exact, BuiltIn("villa", 3))}
    assert len(keys) == 2


def test_built_in_scenes_can_be_listed_each_with_its_first_seed() -> None:
    text = "builtin-exact:villa*2@7, builtin:house, builtin*2@3"
    assert names(text, 1) == [
        "exact-villa-7",
        "exact-villa-8",
        "house-1",
        "apartment-3",
        "apartment-4",
    ]


@pytest.mark.parametrize(
    ("scene", "preset", "first", "count"),
    [
        ("builtin", "gru_vln10", "apartment-3", 10),
        ("builtin-exact:villa@50", "gru_vln10", "exact-villa-50", 10),
        ("builtin", "lab_3dgs", "apartment-3", 1),
        ("builtin", "", "apartment-3", 1),
        # Who writes a number means it.
        ("builtin*1", "gru_vln10", "apartment-3", 1),
    ],
)
def test_one_kind_of_building_is_as_many_as_a_preset_needs(scene, preset, first, count) -> None:
    found = list(sources_of(Collect(scene=scene, seed=3), [], preset))
    assert found[0] == first
    assert len(found) == count


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("builtin:villa@x", "'x' is not a seed"),
        ("builtin:villa@-1", "'-1' is not a seed"),
        ("builtin*3@1,builtin@2", "apartment-2 is listed twice"),
        ("builtin,scan.glb", "'scan.glb' is not a built-in scene"),
    ],
)
def test_a_bad_list_of_buildings_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_builtin(text, 0)


@pytest.mark.parametrize("text", ["scan.glb", "built", "builtins", "my/builtin", "builtin.glb"])
def test_anything_else_is_a_file(text: str) -> None:
    assert parse_builtin(text, 0) == []


@pytest.mark.parametrize(
    "text", ["builtin:castle", "builtin:", "builtin:castle*10", "builtin:Villa"]
)
def test_unknown_kinds_name_the_valid_ones(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_builtin(text, 0)
    assert "\n" not in str(caught.value)
    for kind in BUILDINGS:
        assert kind in str(caught.value)


@pytest.mark.parametrize("count", ["0", "", "-2", "ten", "1001", "²"])
def test_a_bad_number_of_buildings_is_refused(count: str) -> None:
    with pytest.raises(InputError, match=r"1 to 1,000.*\*10"):
        parse_builtin(f"builtin:villa*{count}", 0)


def test_collect_refuses_an_unknown_kind_before_it_writes(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with pytest.raises(InputError, match=r"castle.*villa"):
        run(Collect(scene="builtin:castle*10", out=out))
    assert not out.exists()


def test_scan_refuses_an_unknown_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "scan"
    assert main(["scan", "0", "--kind", "castle", "--out", str(out)]) == 2
    assert "office" in capsys.readouterr().err
    assert not out.exists()


def test_buildings_have_keys_of_their_own(tmp_path: Path) -> None:
    buildings = [BuiltIn(kind, seed) for kind in BUILDINGS for seed in (0, 1)]
    keys = {scene_items.scan_item(building, tmp_path).key for building in buildings}
    assert len(keys) == 2 * len(BUILDINGS)
