"""Find the packages: the folders at the top of the repository are sub-packages of `vlnpe`."""

from setuptools import find_namespace_packages, setup

FOLDERS = """apartments collectors datasets evaluation formats geometry instruction_gen learning
pipeline rendering scene_repair trajectory_sampler viewer wayfinding""".split()
DATA = "css html j2 js json safetensors toml txt typed xml yaml".split()

inner = find_namespace_packages(
    include=[pattern for name in FOLDERS for pattern in (name, f"{name}.*")],
    exclude=["*__pycache__*"],
)
setup(
    packages=["vlnpe", *(f"vlnpe.{name}" for name in inner)],
    package_dir={"vlnpe": "package", **{f"vlnpe.{name}": name for name in FOLDERS}},
    package_data={"": [f"*.{suffix}" for suffix in DATA]},
)
