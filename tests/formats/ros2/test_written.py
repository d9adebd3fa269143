"""Texts of a robot's log are written beside its films, and converted with it."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.instruction_gen.test_review import ask, serving
from tests.support.robot_logs import convert_log, write_log
from vlnpe.formats.convert.episodes import DATASET_NAME
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.lerobot import read_episode_unit
from vlnpe.pipeline import cli
from vlnpe.pipeline.commands.review import log_walks, units_of_log
from vlnpe.pipeline.options.instructions import Review

pytestmark = pytest.mark.usefixtures("inline")


def test_texts_are_written_on_the_page_and_become_the_datasets(tmp_path: Path) -> None:
    write_log(tmp_path / "walk", seconds=4.0, hole=(1.5, 2.5))
    status, out = convert_log(tmp_path / "walk")
    units = units_of_log(out)
    walks = log_walks(Review(out), units)
    assert status == 0 and walks.names == ["walk-000", "walk-001"]
    told = {"path": "walk-001", "number": 0, "annotator": "ann"}
    with serving(walks) as address:
        _, answer = ask(address, "/api/path?number=1")
        shown = json.loads(answer)
        assert shown["texts"][0]["text"] == "" and shown["next_unjudged"] == 0
        end_m, start_m = shown["path"][-1], shown["path"][0]
        assert end_m[1] > 0.5 and abs(end_m[0]) < 0.2 and start_m == [0, 0]  # ahead is up
        _, film = ask(address, "/api/film?name=walk-001")
        assert film == units[1].joinpath("observation.images.rgb.mp4").read_bytes()
        for body, expected in (
            ({"action": "edit", "text": "Go past\nthe sofa."}, 200),
            ({"action": "edit", "text": " "}, 409),
            ({"action": "edit", "text": 2001 * "é"}, 409),
            ({"action": "accept"}, 409),
            ({"action": "edit", "text": "x", "path": "walk-002"}, 400),
        ):
            status, answer = ask(address, "/api/decide", told | body)
            assert status == expected
            assert ("2,001 characters" in answer.decode()) == (len(body.get("text", "")) > 2000)
        shown = json.loads(ask(address, "/api/path?number=1")[1])
        assert (shown["texts"][0]["text"], shown["agreement"]["judged"]) == ("Go past the sofa.", 1)
        ask(address, "/api/decide", told | {"action": "edit", "text": "No.", "path": "walk-000"})
        ask(address, "/api/decide", told | {"action": "undo", "path": "walk-000"})
    assert convert_log(tmp_path / "walk", "--instruction", str(walks.texts))[0] == 0
    assert [read_episode_unit(unit).task for unit in units] == ["", "Go past the sofa."]
    episodes = pq.read_table(out / "lerobot" / "walk" / "meta" / "episodes")
    assert episodes["tasks"].to_pylist() == [[""], ["Go past the sofa."]]


def test_two_servers_of_one_file_lose_no_text(tmp_path: Path) -> None:
    write_log(tmp_path / "walk", seconds=8.0, hole=(3.0, 4.0))
    _, out = convert_log(tmp_path / "walk")
    servers = [log_walks(Review(out), units_of_log(out)) for _ in range(2)]

    def write(number: int) -> None:
        for text in "abcdefgh":
            body = {"path": f"walk-00{number}", "action": "edit", "text": text}
            servers[number].decide("ann", body)
            assert json.loads(servers[0].texts.read_text())[f"walk-00{number}"] == text

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write, range(2)))


@pytest.mark.parametrize("way", ["lerobot", "mcap"])
def test_a_log_converted_again_is_no_log_whose_texts_could_be_written(
    tmp_path: Path, way: str
) -> None:
    write_log(tmp_path / "walk", seconds=2.0)
    _, out = convert_log(tmp_path / "walk", "--to", way)
    other = {"lerobot": "mcap", "mcap": "lerobot"}[way]
    command = ["convert", str(out / way / "walk"), "--to", other, "--out", str(tmp_path / "b")]
    assert cli.main(command) == 0
    assert len(units_of_log(out)) == 1 and units_of_log(tmp_path / "b") == []


@pytest.mark.parametrize("facts", ["{}", '{"provenance": []}', '{"provenance": {"converted": 1}}'])
def test_units_of_elsewhere_are_no_log(tmp_path: Path, facts: str) -> None:
    unit = tmp_path / "units" / "a" / "b"
    unit.mkdir(parents=True)
    (unit / DATASET_NAME).write_text(facts)
    assert units_of_log(tmp_path) == []
    (unit / DATASET_NAME).write_text("[]")
    with pytest.raises(FileFormatError, match=DATASET_NAME):
        units_of_log(tmp_path)


def test_names_of_several_logs_are_kept_apart(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_log(tmp_path / folder / "walk", seconds=2.0)
        status, out = convert_log(tmp_path / folder / "walk")
        assert status == 0
    other = tmp_path / "a" / "out" / "units" / "walk"
    other.rename(out / "units" / "other")
    with pytest.raises(InputError, match="logs of other, walk; convert each into a folder"):
        log_walks(Review(out), units_of_log(out))
