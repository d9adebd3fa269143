"""VLN-CE files: strict reading, exact round trips, what Habitat's loader needs."""

import copy
import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.support.rollouts import make_episode
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.frames import habitat_to_world_yaw
from vlnpe.formats.vlnce.files import read_episodes, read_vlnce, write_episodes, write_vlnce
from vlnpe.formats.vlnce.records import scene_stem

PUBLIC = {
    "episodes": [
        {
            "episode_id": 1,
            "trajectory_id": 4,
            "scene_id": "mp3d/zsNo4HB9uLZ/zsNo4HB9uLZ.glb",
            "start_position": [2.2725, 0.1, -1.5],
            "start_rotation": [0, 0.5, 0, 0.866],
            "info": {"geodesic_distance": 6.43},
            "goals": [{"position": [-0.5, 0.1, 4.0], "radius": 3.0}],
            "instruction": {"instruction_text": "Walk out.", "instruction_tokens": [5, 6, 0]},
            "reference_path": [[2.2725, 0.1, -1.5], [-0.5, 0.1, 4.0]],
            "a_key_of_tomorrow": {"deep": [1, 2]},
        }
    ],
    "instruction_vocab": {"word_list": ["<pad>", "<unk>"], "UNK_INDEX": 1, "PAD_INDEX": 0},
    "made_by": "somebody",
}


def save(path: Path, document) -> Path:
    data = json.dumps(document).encode()
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return path


@pytest.fixture(params=["a.json.gz", "a.json"])
def public(request, tmp_path):
    return save(tmp_path / request.param, PUBLIC)


def test_reads_public_schema(public):
    file = read_vlnce(public)
    (episode,) = file.episodes
    assert episode.episode_id == 1
    assert episode.scene_stem == "zsNo4HB9uLZ"
    assert episode.start_position_habitat_m.tolist() == [2.2725, 0.1, -1.5]
    assert habitat_to_world_yaw(episode.start_rotation_xyzw) == pytest.approx(
        np.deg2rad(150), abs=1e-3
    )
    assert episode.goals[0].radius_m == 3.0
    assert episode.reference_path_habitat_m.shape == (2, 3)
    assert episode.extra == {"a_key_of_tomorrow": {"deep": [1, 2]}}
    assert file.extra == {"made_by": "somebody"}
    assert not episode.in_repaired_world


def test_public_file_is_written_back_as_it_was(public, tmp_path):
    out = tmp_path / "back.json"
    write_vlnce(out, read_vlnce(public))
    assert json.loads(out.read_text()) == PUBLIC


def test_test_split_has_no_goals_and_stays_so(tmp_path):
    document = copy.deepcopy(PUBLIC)
    for key in ("goals", "reference_path", "info"):
        del document["episodes"][0][key]
    file = read_vlnce(save(tmp_path / "test.json", document))
    assert file.episodes[0].goals == ()
    assert file.episodes[0].reference_path_habitat_m.shape == (0, 3)
    write_vlnce(tmp_path / "back.json", file)
    again = json.loads((tmp_path / "back.json").read_text())["episodes"][0]
    assert "goals" not in again
    assert "reference_path" not in again


BROKEN = {
    "start_position": ([1.0, 2.0], "start_position must be 3 finite numbers"),
    "start_rotation": ([0, 0, 0, 2], "length 1"),
    "scene_id": (7, "scene_id"),
    "episode_id": (None, "episode_id"),
    "trajectory_id": ([1], "trajectory_id"),
    "instruction": ({"instruction_text": 3}, "instruction_text"),
    "goals": ([{"position": [0, 0, 0], "radius": -1}], "goals[0].radius"),
    "reference_path": ([[0, 0, 0], [0, 0, "x"]], "reference_path[1]"),
    "info": ([], "info"),
}


@pytest.mark.parametrize("key", BROKEN)
def test_a_broken_key_is_named_with_file_and_episode(tmp_path, key):
    document = copy.deepcopy(PUBLIC)
    value, complaint = BROKEN[key]
    document["episodes"][0][key] = value
    path = save(tmp_path / "broken.json.gz", document)
    with pytest.raises(FileFormatError) as caught:
        read_vlnce(path)
    message = str(caught.value)
    assert "\n" not in message
    name = "number 0" if key == "episode_id" else "episode 1"
    assert all(part in message for part in (str(path), complaint, name))


def test_repeated_ids_are_quarantined(tmp_path):
    document = copy.deepcopy(PUBLIC)
    document["episodes"] *= 2
    file = read_vlnce(save(tmp_path / "twice.json", document))
    assert [e.episode_id for e in file.episodes] == [1]
    assert [(b.index, b.episode_id) for b in file.bad] == [(1, 1)]
    assert "twice" in file.bad[0].reason


BAD_VALUES = {
    "missing field": lambda e: e.pop("start_rotation"),
    "NaN": lambda e: e["reference_path"][0].__setitem__(0, float("nan")),
    "wrong type": lambda e: e.__setitem__("instruction", "Walk out."),
    "number as text": lambda e: e["goals"][0].__setitem__("position", ["1", "2", "3"]),
    "boolean as number": lambda e: e["start_position"].__setitem__(0, True),
}


@pytest.mark.parametrize("damage", BAD_VALUES)
def test_one_bad_episode_does_not_cost_the_others(tmp_path, damage):
    document = copy.deepcopy(PUBLIC)
    document["episodes"] = [copy.deepcopy(PUBLIC["episodes"][0]) for _ in range(3)]
    for k, episode in enumerate(document["episodes"]):
        episode["episode_id"] = 10 + k
    BAD_VALUES[damage](document["episodes"][1])
    path = save(tmp_path / "a.json.gz", document)
    file = read_vlnce(path)
    assert [e.episode_id for e in file.episodes] == [10, 12]
    (bad,) = file.bad
    assert (bad.index, bad.episode_id) == (1, 11)
    assert bad.name == "11 (number 1)"
    with pytest.raises(FileFormatError, match="11"):
        read_vlnce(path, strict=True)


RXR = {
    "episodes": [
        {
            "reference_path": [[2, 0.1, -1.5], [-0.5, 0.1, 4.0]],
            "episode_id": "4",
            "trajectory_id": "17",
            "novel": {"z": 1, "a": [None, {"y": 0, "b": 1}]},
            "scene_id": "mp3d/zsNo4HB9uLZ/zsNo4HB9uLZ.glb",
            "start_position": [2, 0.1, -1.5],
            "start_rotation": [0, 0.5, 0, 0.866],
            "info": {"role": "guide"},
            "goals": [{"radius": 3, "position": [-0.5, 0.1, 4.0], "of": "tomorrow"}],
            "instruction": {
                "instruction_id": "11",
                "language": "hi-IN",
                "timed_instruction": [{"word": "आप", "start_time": 0.1, "end_time": 0.4}],
                "instruction_text": "आप चलिए",
                "annotator_id": "3",
            },
        },
        {
            "episode_id": "5",
            "trajectory_id": "18",
            "scene_id": "mp3d/X/X.glb",
            "start_position": [0, 0, 0],
            "start_rotation": [0, 0, 0, 1],
            "instruction": {"instruction_text": "Test.", "instruction_tokens": None},
            "goals": None,
            "reference_path": None,
        },
    ],
    "novel": 1,
    "instruction_vocab": {"word_list": []},
}


def test_rxr_comes_back_key_by_key_in_its_order(tmp_path):
    source = save(tmp_path / "val_unseen_guide.json.gz", RXR)
    file = read_vlnce(source)
    assert file.split == "val_unseen"
    assert file.episodes[0].unknown_keys["source_instruction"]["language"] == "hi-IN"
    assert file.episodes[0].unknown_keys["source_goals"] == [{"of": "tomorrow"}]
    assert file.episodes[1].unknown_keys == {}
    write_vlnce(tmp_path / "back.json", file)
    assert (tmp_path / "back.json").read_text() == json.dumps(RXR, ensure_ascii=False)


def test_a_changed_record_is_written_changed(tmp_path):
    file = read_vlnce(save(tmp_path / "a.json", RXR))
    position, info = np.array([9.0, 0.1, -1.5]), {"role": "guide", "checked": True}
    moved = replace(file.episodes[0], start_position_habitat_m=position, info=info)
    write_vlnce(tmp_path / "back.json", replace(file, episodes=(moved,)))
    (episode,) = json.loads((tmp_path / "back.json").read_text())["episodes"]
    expected = copy.deepcopy(RXR["episodes"][0])
    expected["start_position"][0] = 9.0
    expected["info"]["checked"] = True
    assert list(episode) == list(expected)
    assert episode == expected


numbers = st.floats(-1e4, 1e4)
points = arrays(np.float64, 3, elements=numbers)
paths = arrays(np.float64, st.tuples(st.integers(1, 5), st.just(3)), elements=numbers)
episodes = st.builds(
    Episode,
    episode_id=st.text("abc-012", min_size=1),
    trajectory_id=st.text(min_size=1, alphabet="xyz"),
    scene_id=st.sampled_from(["home", "mp3d/a/a.glb"]),
    split=st.sampled_from(["train", "val_unseen"]),
    level=st.integers(0, 3),
    start_position_world_m=points,
    start_yaw_rad=st.floats(-np.pi, np.pi),
    goal_position_world_m=points,
    reference_path_world_m=paths,
    geodesic_distance_m=st.floats(0, 100),
    instruction=st.text(max_size=60, alphabet=st.characters(codec="utf-8")),
    goal_radius_m=st.floats(0.1, 5),
    extra=st.dictionaries(st.text(), st.one_of(st.integers(), st.text(), st.none())),
)


def same(a: Episode, b: Episode) -> bool:
    return all(np.array_equal(value, vars(b)[key]) for key, value in vars(a).items())


@settings(max_examples=60, deadline=None)
@given(st.lists(episodes, max_size=3, unique_by=lambda e: e.episode_id))
def test_our_episodes_round_trip_exactly(tmp_path_factory, given_episodes):
    path = tmp_path_factory.mktemp("ours") / "ours.json.gz"
    write_episodes(path, given_episodes)
    back = read_episodes(path)
    assert len(back) == len(given_episodes)
    assert all(same(a, b) for a, b in zip(given_episodes, back, strict=True))
    first = path.read_bytes()
    write_episodes(path, back)
    assert path.read_bytes() == first


@pytest.fixture
def ours():
    text = "Leave the bedroom, turn left and stop. Leave!"
    return replace(make_episode(0, text), episode_id="home-0")


def test_habitat_loaders_find_only_known_keys(tmp_path, ours):
    write_episodes(tmp_path / "a.json", [ours])
    document = json.loads((tmp_path / "a.json").read_text())
    # Habitat builds its record from exactly these keywords; one more is a TypeError there.
    assert set(document["episodes"][0]) == set(PUBLIC["episodes"][0]) - {"a_key_of_tomorrow"}
    assert document["episodes"][0]["start_position"] == [1.0, 0.0, -2.0]
    assert habitat_to_world_yaw(document["episodes"][0]["start_rotation"]) == pytest.approx(0.3)


def test_tokens_and_vocabulary_agree(tmp_path, ours):
    write_episodes(tmp_path / "a.json", [ours, replace(ours, episode_id="b", instruction="Turn")])
    document = json.loads((tmp_path / "a.json").read_text())
    vocabulary = document["instruction_vocab"]
    words = vocabulary["word_list"]
    assert set(vocabulary) == {
        "word_list", "word2idx_dict", "stoi", "itos", "num_vocab", "UNK_INDEX", "PAD_INDEX",
    }  # fmt: skip
    assert vocabulary["num_vocab"] == len(words) == len(set(words))
    tokens = document["episodes"][0]["instruction"]["instruction_tokens"]
    text = [words[t] for t in tokens if t != vocabulary["PAD_INDEX"]]
    assert " ".join(text) == "leave the bedroom , turn left and stop . leave !"
    assert len(tokens) == 200


def test_foreign_files_must_be_aligned_first(public):
    with pytest.raises(FileFormatError, match="align"):
        read_episodes(public)


def test_damaged_own_keys_are_named(tmp_path, ours):
    path = tmp_path / "a.json"
    write_episodes(path, [ours])
    document = json.loads(path.read_text())
    del document["episodes"][0]["info"]["vlnpe"]["level"]
    with pytest.raises(FileFormatError, match=r"home-0.*level"):
        read_episodes(save(path, document))
    document["episodes"][0]["info"]["vlnpe"]["format_version"] = 99
    with pytest.raises(FileFormatError, match="version 99"):
        read_episodes(save(path, document))


def test_two_episodes_of_one_id_are_not_written(tmp_path, ours):
    with pytest.raises(ValueError, match="home-0"):
        write_episodes(tmp_path / "a.json", [ours, ours])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("scene_id", "stem"),
    [("mp3d/X/X.glb", "X"), ("home.v2", "home.v2"), ("a/b.USDC", "b"), ("house", "house")],
)
def test_scene_stem(scene_id, stem):
    assert scene_stem(scene_id) == stem
