"""Paths over storeys: controllers and the expert, leg after leg, without a stop in between."""

from dataclasses import replace

from ...formats.core.rollout import Action
from .expert import Expert, ExpertConfig
from .flight import FlightController, FlightExpert
from .interface import Controller, Decision, Pose, Task
from .path import PathConfig, PathController


class LegsController:
    """The controller `path` over storeys: `FlightController` on stairs; satisfies `Controller`."""

    rate_hz = 25

    def __init__(self, task: Task, config: PathConfig) -> None:
        self._controllers: list[Controller] = [
            FlightController(leg) if leg.is_stairs else PathController(leg, config)
            for leg in task.legs
        ]
        self._at, self._since_s = 0, 0.0

    @property
    def nominal_s(self) -> float:
        """Time of all legs."""
        return sum(controller.nominal_s for controller in self._controllers)

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`."""
        notes: tuple[tuple[str, str], ...] = ()
        while True:
            decision = self._controllers[self._at].step(time_s - self._since_s, pose)
            notes += decision.notes
            if not decision.done or self._at == len(self._controllers) - 1:
                return replace(decision, notes=notes)
            self._at, self._since_s = self._at + 1, time_s


class LegsExpert:
    """The expert over storeys; stops at the end of the last leg alone. Satisfies `Chooser`.

    It takes the legs one after another, and never goes back to one that it has finished.

    Attributes:
        length_m, stairs_m, turning_rad: see `Expert`; the length is that on levels.
    """

    def __init__(self, task: Task, config: ExpertConfig) -> None:
        self._experts: list[Expert | FlightExpert] = [
            FlightExpert(leg) if leg.is_stairs else Expert(leg, config) for leg in task.legs
        ]
        self.length_m = sum(expert.length_m for expert in self._experts)
        self.stairs_m = sum(expert.stairs_m for expert in self._experts)
        self.turning_rad = sum(expert.turning_rad for expert in self._experts)
        self._at = 0

    def notes(self) -> list[tuple[str, str]]:
        """See `Expert.notes`."""
        return [note for expert in self._experts for note in expert.notes()]

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """See `Expert.next_action`."""
        while True:
            action = self._experts[self._at].next_action(pose, rest)
            if action is not Action.STOP or self._at == len(self._experts) - 1:
                return action
            self._at += 1


def expert_for(task: Task, config: ExpertConfig | None = None) -> Expert | LegsExpert:
    """Return the expert of a task."""
    config = config or ExpertConfig()
    return LegsExpert(task, config) if task.legs else Expert(task, config)


def path_controller(task: Task, config: PathConfig) -> PathController | LegsController:
    """Return the controller `path` of a task."""
    return LegsController(task, config) if task.legs else PathController(task, config)
