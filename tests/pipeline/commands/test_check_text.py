"""`vlnpe check-text`: what is wrong with a file of texts is said by file, line and valid form."""

import pytest

from vlnpe.formats.core.errors import FileFormatError
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


def test_bytes_and_missing_files_are_named(tmp_path) -> None:
    (tmp_path / "bytes").write_bytes(b"\xff\xfe")
    for name, reason in (("bytes", "not UTF-8"), ("none", "No such file or directory")):
        with pytest.raises(FileFormatError, match=f"{name}: {reason}; valid: on each line"):
            list(read_texts(tmp_path / name))
