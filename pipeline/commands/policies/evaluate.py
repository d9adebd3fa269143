"""Commands for closed loop: `evaluate` and `compare`."""

import shlex
from dataclasses import asdict
from math import isnan

from ....evaluation.results import (
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
from ....evaluation.statistics import LEAST_PATHS
from ....formats.core.checkout import program
from ...collect.evaluation import Evaluation, evaluate_policy
from ...options.evaluate import Compare, Evaluate
from ...report.policy_items import PAGE_NAME
from ...summary import print_result


def run_evaluate(options: Evaluate) -> int:
    """Evaluate a policy and print its results."""
    evaluation = evaluate_policy(options)
    _print(options, evaluation)
    return int(len(evaluation.results["quarantined"]) > options.max_failed)


def run_compare(options: Compare) -> int:
    """Compare two evaluations."""
    names = (str(options.first), str(options.second))
    comparison = compare(read_results(options.first), read_results(options.second), names)
    differences = {name: interval_json(v) for name, v in comparison.differences.items()}
    facts = {**asdict(comparison), "differences": differences}
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
    return print_result(options, facts, "\n".join(lines))


def _print(options: Evaluate, evaluation: Evaluation) -> None:
    out, value = evaluation.out, evaluation.results
    groups = grouped(value["episodes"], "split")
    if len(groups) > 1:
        groups["all"] = value["episodes"]
    setting, quarantined = value["setting"], value["quarantined"]
    lines = [
        f"\npolicy {setting['policy']} drives {setting['robot']} ({setting['controller']})",
        f"{table(groups)}\n\n{LEGEND}" if groups else "no episode has a result",
        "",
    ]
    if quarantined:
        reason = next(iter(quarantined.values()))
        lines.append(f"{len(quarantined)} episodes without a result, counted apart: {reason}")
    for count, what in COUNTS.items():
        if total := sum(episode.get(count, 0) for episode in value["episodes"]):
            lines.append(f"{total} {what}")
    lines.append(f"results: {out / RESULTS_NAME}")
    if options.films > 0:
        lines.append(f"report:  {out / PAGE_NAME}")
    else:
        walks, scenes, films = (
            shlex.quote(str(path)) for path in (out, evaluation.scenes, out / "films")
        )
        lines += [
            'films:   the same command with --films 2 (of make: ARGS="--films 2"), or',
            f"         {program()} render {walks} --scenes {scenes} --video --camera chase "
            f"--out {films}",
        ]
    facts = {k: value[k] for k in ("setting", "summary", "quarantined")} | {"out": str(out)}
    print_result(options, facts, "\n".join(lines))
