"""Commands for closed loop: `evaluate` and `compare`."""

import json
import shlex
import sys
from dataclasses import asdict
from math import isnan

from ...evaluation.results import (
    COLUMNS,
    COUNTS,
    LEGEND,
    RESULTS_NAME,
    compare,
    decimals,
    grouped,
    interval_json,
    read_results,
    table,
)
from ...evaluation.statistics import LEAST_PATHS
from ...formats.core.checkout import program
from ..chains.evaluation import Evaluation, evaluate_policy
from ..options.evaluate import Compare, Evaluate
from ..report.policy_items import PAGE_NAME


def run_evaluate(options: Evaluate) -> int:
    """Evaluate a policy and print its results.

    Raises:
        InputError: If a name is unknown, or a file or folder cannot be used.
    """
    evaluation = evaluate_policy(options)
    _print(options, evaluation)
    return int(len(evaluation.results["quarantined"]) > options.max_failed)


def run_compare(options: Compare) -> int:
    """Compare two evaluations.

    Raises:
        InputError: If a file is no results file, or they have no episode in common.
    """
    names = (str(options.first), str(options.second))
    comparison = compare(read_results(options.first), read_results(options.second), names)
    if options.json:
        differences = {name: interval_json(v) for name, v in comparison.differences.items()}
        value = {**asdict(comparison), "differences": differences}
        sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
        return 0
    lines = [f"warning: {text}" for text in comparison.warnings]
    lines += [
        f"{comparison.common} episodes in both, {comparison.apart} in one only",
        f"only {names[0]} succeeds: {len(comparison.lost)}  {', '.join(comparison.lost[:10])}",
        f"only {names[1]} succeeds: {len(comparison.won)}  {', '.join(comparison.won[:10])}",
        f"McNemar's exact test: p = {comparison.p_value:.3g}",
        "",
    ]
    few = all(isnan(change.low) for change in comparison.differences.values())
    interval = (
        f"mean (no interval of fewer than {LEAST_PATHS} paths)" if few else "mean and 95 % interval"
    )
    lines.append(f"second minus first, {interval} of the paired difference; % are points")
    for name, change in comparison.differences.items():
        d = decimals(name)
        bounds = "" if isnan(change.low) else f" ({change.low:+.{d}f} to {change.high:+.{d}f})"
        lines.append(f"  {name:<5} {change.mean:+8.{d}f} {COLUMNS[name][0]:<2}{bounds}".rstrip())
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _print(options: Evaluate, evaluation: Evaluation) -> None:
    out, value, scenes = evaluation.out, evaluation.results, evaluation.scenes
    if options.json:
        shown = {k: value[k] for k in ("setting", "summary", "quarantined")} | {"out": str(out)}
        sys.stdout.write(json.dumps(shown) + "\n")
        return
    groups = grouped(value["episodes"], "split")
    if len(groups) > 1:
        groups["all"] = value["episodes"]
    who = value["setting"]
    head = f"policy {who['policy']} drives {who['robot']} ({who['controller']})"
    text = f"{table(groups)}\n\n{LEGEND}" if value["episodes"] else "no episode has a result"
    sys.stdout.write(f"\n{head}\n{text}\n\n")
    if value["quarantined"]:
        count = len(value["quarantined"])
        reason = next(iter(value["quarantined"].values()))
        sys.stdout.write(f"{count} episodes without a result, counted apart: {reason}\n")
    for count, what in COUNTS.items():
        if total := sum(episode.get(count, 0) for episode in value["episodes"]):
            sys.stdout.write(f"{total} {what}\n")
    sys.stdout.write(f"results: {out / RESULTS_NAME}\n")
    if options.films > 0:
        sys.stdout.write(f"report:  {out / PAGE_NAME}\n")
        return
    walks, films = shlex.quote(str(out)), shlex.quote(str(out / "films"))
    sys.stdout.write(
        'films:   the same command with --films 2 (of make: ARGS="--films 2"), or\n'
        f"         {program()} render {walks} --scenes {shlex.quote(str(scenes))} --video "
        f"--camera chase --out {films}\n"
    )
