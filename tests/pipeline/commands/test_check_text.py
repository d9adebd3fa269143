"""`vlnpe check-text`: what is wrong with a file of texts is said by file, line and valid form."""

import json
from dataclasses import replace

import pytest

from tests.support.episodes import episode_along
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.pipeline import cli
from vlnpe.pipeline.commands.check_text import FORM, read_texts

GOOD = b'{"path": "a", "text": "Stop."}\n'


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"not json", f"'not json' is not JSON; valid: {FORM}"),
        (b"[" * 5000, f"is not JSON; valid: {FORM}"),
        (b"[1, 2]", f"valid: {FORM}"),
        (b'{"path": "a", "text": 3}', "text is 3; valid: a text"),
        (b'{"path": "a", "text": "b", "claims": 5}', "claims 5; valid: a list of steps"),
    ],
)
def test_a_bad_line_is_named(tmp_path, line, reason) -> None:
    file = tmp_path / "texts.jsonl"
    file.write_bytes(GOOD + line)
    with pytest.raises(FileFormatError) as raised:
        list(read_texts(file))
    message = str(raised.value)
    assert message.startswith(f"{file}: line 2: ") and reason in message and "char" not in message


def test_files_without_texts_and_paths_that_are_not_there_are_named(two_rooms, tmp_path, capsys):
    path = [(1.0, 2.0), (6.0, 2.0)]
    episode = replace(episode_along(path), scene_id=two_rooms.scene_id)
    write_episodes(tmp_path / "episodes.json.gz", [episode])
    texts = tmp_path / "texts.jsonl"
    command = ["check-text", str(tmp_path / "episodes.json.gz"), "--texts", str(texts)]
    (tmp_path / two_rooms.scene_id).symlink_to(two_rooms.root)
    command += ["--scenes", str(tmp_path)]
    lines = [{"path": episode.trajectory_id, "text": "Walk over to the fnord, then stop."}]
    for content, reason in (
        ([], "no texts"),
        ([*lines, {"path": "x", "text": "a"}], "line 2: unk"),
    ):
        texts.write_text("".join(json.dumps(line) + "\n" for line in content))
        assert cli.main(command) == 2
        assert f"{texts}: {reason}" in capsys.readouterr().err
    texts.write_text(json.dumps(lines[0]))
    assert cli.main(command) == 1, capsys.readouterr().err
    assert "fnord" in capsys.readouterr().out.split("'Walk")[0]  # before the text itself


def test_bytes_and_missing_files_are_named(tmp_path) -> None:
    (tmp_path / "bytes").write_bytes(b"\xff\xfe")
    for name, reason in (("bytes", "not UTF-8"), ("none", "No such file or directory")):
        with pytest.raises(FileFormatError, match=f"{name}: {reason}; valid: on each line"):
            list(read_texts(tmp_path / name))
