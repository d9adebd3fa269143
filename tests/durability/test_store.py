"""Run folders in an object store: a server that speaks S3's API, and real commands."""

import logging
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("s3fs")
import s3fs
from moto.server import ThreadedMotoServer

from tests.support.runs import tiny_run
from tests.support.runs.content import content
from tests.support.runs.kills import kill_in
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline import cli
from vlnpe.pipeline.engine.holder import Holder
from vlnpe.pipeline.engine.ledger import MANIFEST_NAME, Ledger, Row
from vlnpe.pipeline.engine.lock import LOCK_NAME, LockedError
from vlnpe.pipeline.store import holding
from vlnpe.pipeline.store.address import MARKER_NAME, SCRATCH_VARIABLE, scratch_folder, store_url
from vlnpe.pipeline.store.mirror import MirroredLedger, local_copy, mirrored, pull
from vlnpe.pipeline.store.objects import ObjectFolder, StoreError

URL = "s3://bucket/runs/run"


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """The address of a server that speaks S3's API."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    yield "http://{}:{}".format(*server.get_host_and_port())
    server.stop()


@pytest.fixture
def bucket(server: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[ObjectFolder]:
    """An empty run folder in an empty bucket, and an empty scratch folder."""
    for name, value in {
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": server,
        SCRATCH_VARIABLE: str(tmp_path / "scratch"),
    }.items():
        monkeypatch.setenv(name, value)
    s3fs.S3FileSystem.clear_instance_cache()
    files = s3fs.S3FileSystem()
    files.mkdir("bucket")
    yield ObjectFolder.open(URL)
    files.rm("bucket", recursive=True)


def _row(name: str, text: str, ledger: Ledger) -> Row:
    """Write a file and record it as the output of an item."""
    path = ledger.root / "out" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    row = Row("work", name, key=text, status="done", outputs=(f"out/{name}",))
    ledger.add(row)
    ledger.record([path])
    return row


@pytest.mark.chain
def test_a_run_killed_on_one_machine_is_completed_on_another(
    bucket: ObjectFolder, scan: Path, finished: Path, prepared: Path
):
    files = (path for path in prepared.rglob("*") if path.is_file())
    bucket.upload({path.relative_to(prepared).as_posix(): path for path in files})
    command = tiny_run.command(scan, Path(URL), "--workers", 1)
    assert kill_in(command, scratch_folder(URL), "dataset", 0.0)
    shutil.rmtree(scratch_folder(URL))  # the next machine has another disk
    bucket.remove([LOCK_NAME])  # and does not know whether the first one lives
    done = tiny_run.collect(scan, Path(URL))
    assert done.returncode == 0, done.stderr[-2000:]
    assert re.search(r"replay vlnce flash +100% 2/2 .*reused 2", done.stderr), done.stderr
    with local_copy(URL) as copy:
        assert content(copy) == content(finished)
    checked = tiny_run.vlnpe("verify", URL)
    assert checked.returncode == 0 and "bad: 0" in checked.stdout, checked.stdout
    name = next(n for n in bucket.names() if n.endswith("rgb.mp4"))
    damaged = bytearray(bucket.read(name) or b"")
    damaged[len(damaged) // 2] ^= 1
    bucket.write(name, bytes(damaged))
    checked = tiny_run.vlnpe("verify", URL)
    assert checked.returncode == 1 and name in checked.stdout


def test_two_machines_add_to_one_run(bucket: ObjectFolder, tmp_path: Path):
    first, second = tmp_path / "first", tmp_path / "second"
    for scratch, name in ((first, "a"), (second, "b")):
        scratch.mkdir()
        ledger = MirroredLedger(scratch, bucket, pull(bucket, scratch))
        _row(name, name, ledger)
        ledger.save()
    pull(bucket, first)
    assert {row.item for row in Ledger(first).all_rows()} == {"a", "b"}
    assert (first / "out/b").read_text() == "b"
    assert set(bucket.names()) >= {"out/a", "out/b", MANIFEST_NAME}


@pytest.mark.parametrize("scratch", ["same", "another"])
def test_a_truncated_object_is_uploaded_again_or_its_item_redone(
    bucket: ObjectFolder, tmp_path: Path, scratch: str
):
    for name in ("same", "another"):
        (tmp_path / name).mkdir()
    ledger = MirroredLedger(tmp_path / "same", bucket, {})
    row = _row("a", "whole", ledger)
    ledger.finish()
    bucket.write("out/a", b"who")
    root = tmp_path / scratch
    later = MirroredLedger(root, bucket, pull(bucket, root))
    assert later.is_done("work", "a", row.key) == (scratch == "same")
    if scratch == "another":
        _row("a", "whole", later)
    later.finish()
    assert bucket.read("out/a") == b"whole"


def test_work_not_uploaded_joins_that_of_another_machine(bucket: ObjectFolder, tmp_path: Path):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    offline = Ledger(here)
    _row("a", "mine", offline)
    _row("both", "mine", offline)
    there.mkdir()
    other = MirroredLedger(there, bucket, {})
    _row("both", "theirs", other)
    other.save()
    merged = MirroredLedger(here, bucket, pull(bucket, here))
    assert (here / "out/a").read_text() == "mine"
    assert (here / "out/both").read_text() == "theirs"
    merged.finish()
    with local_copy(URL) as copy:
        assert {row.key for row in Ledger(copy).all_rows()} == {"mine", "theirs"}


def test_no_row_of_the_store_ever_lacks_its_file(
    bucket: ObjectFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Replacing and removing files fails in the middle, at every call."""
    ledger = MirroredLedger(tmp_path, bucket, {})
    for name in "abc":
        _row(name, f"old {name}", ledger)
    ledger.save()
    _row("a", "new a", ledger)
    _row("d", "new d", ledger)
    ledger.forget("work", ["b"])
    (tmp_path / "out/b").unlink()
    calls = 0
    failing = 0
    for method in ("write", "upload", "remove"):
        original = getattr(ObjectFolder, method)

        def limited(self, *arguments, original=original):
            nonlocal calls
            calls += 1
            if calls == failing:
                raise StoreError("the network is down")
            return original(self, *arguments)

        monkeypatch.setattr(ObjectFolder, method, limited)
    for failing in range(1, 7):
        calls = 0
        try:
            ledger.upload()
        except StoreError:
            assert calls == failing
        with local_copy(URL) as copy:
            for name, record in Ledger(copy).files().items():
                assert type(record).of(copy / name) == record
    assert sorted(row.key for row in Ledger(tmp_path).all_rows()) == ["new a", "new d", "old c"]
    assert [n for n in bucket.names() if n.startswith("out/")] == ["out/a", "out/c", "out/d"]


def test_a_scratch_folder_without_its_manifest_empties_nothing(
    bucket: ObjectFolder, tmp_path: Path
):
    ledger = MirroredLedger(tmp_path, bucket, {})
    _row("a", "a", ledger)
    ledger.save()
    assert (tmp_path / MARKER_NAME).is_file()
    (tmp_path / MANIFEST_NAME).unlink()
    MirroredLedger(tmp_path, bucket, pull(bucket, tmp_path)).finish()
    assert "out/a" in bucket.names()


def test_the_second_process_is_refused(bucket: ObjectFolder, monkeypatch: pytest.MonkeyPatch):
    with mirrored(URL), pytest.raises(LockedError, match="in use by process"), mirrored(URL):
        pass
    assert LOCK_NAME not in bucket.names()
    here = Holder.this()
    dead = replace(here, pid=2**22 + 1, started="1")
    bucket.write(LOCK_NAME, dead.line())
    with holding.hold(bucket):  # a dead process of this machine
        pass
    elsewhere = replace(here, host="elsewhere")
    bucket.write(LOCK_NAME, elsewhere.line())
    with pytest.raises(LockedError, match="elsewhere"), holding.hold(bucket):
        pass
    monkeypatch.setattr(holding, "STALE_S", 0.3)
    monkeypatch.setattr(holding, "POLL_S", 0.1)
    with holding.hold(bucket, wait=True):  # it has not been renewed while we watched
        pass
    assert LOCK_NAME not in bucket.names()


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("s3://bucket/run", "s3://bucket/run"),
        ("s3:/bucket/run/", "s3://bucket/run"),
        ("memory://run", "memory://run"),
        ("runs/a", None),
        ("/runs/a", None),
        ("S3://bucket/Run", "s3://bucket/Run"),
        ("a:b/c", None),
        ("runs/s3:/a", None),
    ],
)
def test_urls(text: str, url: str | None):
    assert store_url(text) == url
    assert store_url(Path(text)) == url


@pytest.mark.parametrize(
    "text", ["x://y", "C:/runs", "s3://", "s3:", "s3://a\nb", "s3://bucket/\x1b[0m", "S3://\n"]
)
def test_urls_of_no_folder_are_not_taken_for_local_ones(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="valid: a local folder or s3://bucket/name"):
        store_url(Path(text))
    assert cli.main(["sample", "scene", "--out", text]) == 2
    assert cli.main(["collect", "--out", text]) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 2 and "\x1b" not in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("place", ["user:secret@bucket/run", "KEY:sec/ret@bucket/run", ":secret@b"])
@pytest.mark.parametrize(
    "words", [["verify"], ["collect", "--out"], ["collect", "--scene"], ["mix", "x", "--data"]]
)
def test_a_password_in_a_url_is_never_repeated(
    words: list[str], place: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    for argument in ([f"s3://{place}"], [f"S3:/{place}"]):
        assert cli.main([*words, *argument]) == 2
    joined = [*words[:-1], f"{words[-1]}=s3://{place}"]
    assert cli.main(joined) == 2
    said = "".join(capfd.readouterr())
    assert "environment" in said and "ret" not in said


def test_errors_name_the_url(bucket: ObjectFolder, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InputError, match=r"nonsense://x.*valid: a local folder or s3://"):
        ObjectFolder.open("nonsense://x")
    with pytest.raises(StoreError, match="s3://nowhere/run"), mirrored("s3://nowhere/run"):
        pass
    failed = tiny_run.vlnpe("verify", "s3://bucket/none")
    assert failed.returncode == 2 and "s3://bucket/none: not a run folder" in failed.stderr
