"""A model on disk, through a stand-in for llama-cpp-python and, where it is installed, itself."""

import json
import os
from dataclasses import replace
from importlib.util import find_spec

import pytest

from tests.instruction_gen.test_instruct import LEFT, episode_of
from tests.instruction_gen.test_llm import GOOD
from vlnpe.formats.core.errors import InputError
from vlnpe.instruction_gen.instruct import instruct_episodes
from vlnpe.instruction_gen.llm import local
from vlnpe.instruction_gen.llm.local import local_backend
from vlnpe.instruction_gen.llm.settings import settings_from
from vlnpe.instruction_gen.records import InstructConfig

# Does what its file says after the first four bytes, and records what it is asked for.
_STAND_IN = """
import json, os, sys
from pathlib import Path

class Llama:
    def __init__(self, model_path, **options):
        print("the library talks")
        self.file, self.does = Path(model_path), Path(model_path).read_text()[4:].split()
        self.record(options)
        if "aborts" in self.does:
            sys.stderr.write("model.cpp:7: GGML_ASSERT(heads > 0) failed\\n")
            sys.stderr.flush()
            os.abort()
        if "refuses" in self.does:
            sys.stderr.write("load: error loading model: unknown model architecture: 'foo'\\n")
            raise ValueError("Failed to load model from file")

    def record(self, what):
        with self.file.with_suffix(".jsonl").open("a") as file:
            file.write(json.dumps(what) + "\\n")

    def create_chat_completion(self, **asked):
        self.record(asked)
        if "crashes" in self.does or "crashes_once" in self.does and not self.crashed():
            os.abort()
        if "overflows" in self.does:
            raise ValueError("Requested tokens (9000) exceed context window of 8192")
        texts = [{"style": "natural", "text": text} for text in json.loads(os.environ["TEXTS"])]
        content = json.dumps({"instructions": texts})
        used = {"prompt_tokens": 7, "completion_tokens": 5}
        return {"choices": [{"message": {"content": content}}], "usage": used}

    def crashed(self):
        mark = self.file.with_suffix(".crashed")
        was = mark.exists()
        mark.touch()
        return was
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Return a function that makes settings for a file that lets the library do something."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "llama_cpp.py").write_text(_STAND_IN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setenv("TEXTS", json.dumps(GOOD))
    return lambda does="": _settings(tmp_path / "model.gguf", f"GGUF {does}".encode())


def _settings(path, content=None):
    if content is not None:
        path.write_bytes(content)
    return replace(settings_from({"VLNPE_GGUF": str(path)}, local=True), backoff_s=0.0)


def instructed(settings, two_rooms, tmp_path):
    """Return the result of instructing one path with three texts."""
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "two_rooms").symlink_to(two_rooms.root)
    config = InstructConfig(writer="local", count=3, llm=settings)
    return instruct_episodes([episode_of(LEFT)], scenes, config, 0, cache=tmp_path / "cache")


def recorded(tmp_path):
    return [json.loads(line) for line in (tmp_path / "model.jsonl").read_text().splitlines()]


def bounds(schema):
    """Return all numbers in a schema with their names."""
    if isinstance(schema, list):
        return [one for part in schema for one in bounds(part)]
    if not isinstance(schema, dict):
        return []
    own = [(name, value) for name, value in schema.items() if isinstance(value, int)]
    return own + [one for part in schema.values() for one in bounds(part)]


def test_a_local_model_writes_and_is_asked_with_small_bounds(stand_in, two_rooms, tmp_path):
    made = instructed(stand_in(), two_rooms, tmp_path)
    assert made.episodes[0].extra["instructions"] == GOOD
    assert made.usage()["tokens_in"] == 7 and made.usage()["tokens_out"] == 5
    opened, asked = recorded(tmp_path)
    half = max(1, len(os.sched_getaffinity(0)) // 2)
    assert opened["n_threads"] == opened["n_threads_batch"] == half
    assert asked["response_format"]["type"] == "json_object"
    schema = asked["response_format"]["schema"]
    assert schema["properties"]["instructions"]["maxItems"] == 3
    assert "text" in schema["$defs"]["Text"]["properties"]
    assert max(value for _, value in bounds(schema)) <= 64
    assert 0 < asked["max_tokens"] < 8192


def test_an_answer_longer_than_a_text_may_be_fails_the_path(
    stand_in, two_rooms, tmp_path, monkeypatch
):
    monkeypatch.setenv("TEXTS", json.dumps(["Go on. " * 300 + GOOD[0]]))
    made = instructed(stand_in(), two_rooms, tmp_path)
    assert made.episodes == [] and "no usable answer" in made.failed["e-0"]


def test_a_crash_of_the_library_is_a_try_that_failed(stand_in, two_rooms, tmp_path):
    made = instructed(stand_in("crashes_once"), two_rooms, tmp_path)
    assert made.episodes[0].extra["instructions"] == GOOD
    assert len(recorded(tmp_path)) == 4  # opened and asked, twice


@pytest.mark.parametrize("does", ["crashes", "overflows"])
def test_a_model_that_never_answers_fails_the_path(stand_in, two_rooms, tmp_path, does):
    made = instructed(stand_in(does), two_rooms, tmp_path)
    assert made.episodes == [] and "no usable answer" in made.failed["e-0"]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"PK\x03\x04", "not a GGUF file$"),
        (b"", "not a GGUF file$"),
        (b"GGUF refuses", r"cannot open it \(unknown model architecture: 'foo'\)$"),
        (b"GGUF aborts", r"cannot open it \(.*GGML_ASSERT\(heads > 0\) failed\)$"),
    ],
)
def test_a_file_that_cannot_be_opened_is_named_in_one_line(stand_in, tmp_path, content, reason):
    stand_in()
    settings = _settings(tmp_path / "bad.gguf", content)
    with pytest.raises(InputError, match=reason) as raised:
        local_backend(settings, texts=1)
    assert "bad.gguf" in str(raised.value) and "\n" not in str(raised.value)


def test_without_the_library_the_message_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setattr(local, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"--writer local needs llama-cpp-python: .*install"):
        local_backend(_settings(tmp_path / "model.gguf", b"GGUF"), texts=1)


def tiny_model(path, architecture="llama"):
    """Write a model of one layer with random weights, whose words are the 256 bytes."""
    gguf = pytest.importorskip("gguf", reason="gguf is not installed; it writes the model")
    np = pytest.importorskip("numpy")
    writer = gguf.GGUFWriter(path, architecture)
    rng, width, hidden = np.random.default_rng(0), 32, 64
    writer.add_context_length(8192)
    writer.add_embedding_length(width)
    writer.add_block_count(1)
    writer.add_feed_forward_length(hidden)
    writer.add_head_count(2)
    writer.add_head_count_kv(2)
    writer.add_layer_norm_rms_eps(1e-5)
    words = ["<unk>", "<s>", "</s>", *(f"<0x{k:02X}>" for k in range(256))]
    writer.add_tokenizer_model("llama")
    writer.add_token_list(words)
    writer.add_token_scores([0.0] * len(words))
    writer.add_token_types([2, 3, 3] + [6] * 256)
    writer.add_bos_token_id(1)
    writer.add_eos_token_id(2)
    square, many = (width, width), (len(words), width)
    shapes = {"token_embd": many, "output": many, "output_norm": (width,)}
    layer = {"attn_q": square, "attn_k": square, "attn_v": square, "attn_output": square}
    layer |= {"attn_norm": (width,), "ffn_norm": (width,), "ffn_down": (width, hidden)}
    layer |= {"ffn_gate": (hidden, width), "ffn_up": (hidden, width)}
    shapes |= {f"blk.0.{name}": shape for name, shape in layer.items()}
    for name, shape in shapes.items():
        writer.add_tensor(f"{name}.weight", rng.normal(size=shape).astype(np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


installed = pytest.mark.skipif(
    find_spec("llama_cpp") is None, reason="llama-cpp-python is not installed"
)


@installed
def test_the_library_writes_the_form_that_is_asked_for(tmp_path):
    tiny_model(tmp_path / "tiny.gguf")
    send = local_backend(_settings(tmp_path / "tiny.gguf"), texts=2)
    reply = send([{"role": "user", "content": "Write two texts."}])
    assert reply.content.replace(" ", "").startswith('{"instructions":[{"style":"')
    assert reply.usage.requests == 1 and 0 < reply.usage.tokens_out <= 1600


@installed
def test_the_library_names_what_is_wrong_with_a_file(tmp_path):
    tiny_model(tmp_path / "foo.gguf", "foo")
    with pytest.raises(InputError, match="unknown model architecture: 'foo'"):
        local_backend(_settings(tmp_path / "foo.gguf"), texts=1)
    tiny_model(tmp_path / "whole.gguf")
    whole = (tmp_path / "whole.gguf").read_bytes()
    for share, reason in ((0.5, "not within the file bounds"), (0.02, "gguf_init_from")):
        cut = _settings(tmp_path / "cut.gguf", whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=reason):
            local_backend(cut, texts=1)
