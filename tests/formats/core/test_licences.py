"""Licences are recognised by name or text, and only known ones let data be passed on."""

from pathlib import Path

import pytest

from vlnpe.formats.core.licences import hub_licence, licence_id, may_pass_on, why_not

MIT = """MIT License\n\nPermission is hereby granted, free of charge, to any person …
The above copyright notice and this permission notice shall be included in all copies."""


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("", "unknown"),
        ("  \n", "unknown"),
        ("Apache-2.0", "apache-2.0"),
        ("MIT License", "mit"),
        ("CC BY 4.0", "cc-by-4.0"),
        (MIT, "mit"),
        ("Permission is hereby granted, free of charge, to any person", "mit-0"),
        (MIT + " For non-commercial use.", "other"),
        ("Attribution 4.0 International", "cc-by-4.0"),
        ("By downloading you agree to the terms of use of the scans", "other"),
        ("https://example.org/terms", "https://example.org/terms"),
    ],
)
def test_a_licence_is_recognised_by_name_or_text(text: str, name: str) -> None:
    assert licence_id(text) == name


@pytest.mark.parametrize(
    ("scan", "name"), [("quest", "mit"), ("room_scan1", "bsd-3-clause"), ("small_house", "mit-0")]
)
def test_licence_files_of_real_scans(shared_scenes: Path, scan: str, name: str) -> None:
    assert licence_id((shared_scenes / f"LICENSE.{scan}").read_text()) == name


@pytest.mark.parametrize("name", ["unknown", "other", "cc-by-nd-4.0", "https://example.org/terms"])
def test_unknown_and_forbidding_licences_may_not_be_passed_on(name: str) -> None:
    assert not may_pass_on(name)
    assert "licence" in why_not(name) or "forbids" in why_not(name)


def test_the_hub_learns_names_that_it_does_not_know() -> None:
    assert hub_licence(["apache-2.0"]) == {"license": "apache-2.0"}
    assert hub_licence([]) == {"license": "unknown"}
    assert hub_licence(["mit-0"])["license_name"] == "mit-0"
    several = hub_licence(["mit", "apache-2.0", "mit"])
    assert (several["license"], several["license_name"]) == ("other", "apache-2.0-and-mit")
