"""`agfb verify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agfb_cli.commands.stage import SECONDS_BEFORE_ANNOUNCEMENT
from agfb_cli.console import Console, finite, table, words
from agfb_cli.errors import ExitCode, explained
from agfb_cli.inputs import existing_store
from agfb_cli.options import AsJson, Quiet, Store, Traceback, Verbose
from agfb_cli.progress import ProgressReporter

if TYPE_CHECKING:
    from pathlib import Path

    from pipelines.stages.certificate.summary import Summary
    from pipelines.stages.reports.verify import Checked, Finding

Sample = Annotated[
    int,
    typer.Option("--sample", metavar="N", min=0, help="Rows of each group to evaluate again; 0 for none."),
]
Plane = Annotated[
    bool,
    typer.Option(
        "--plane",
        help="Compare the curves with the stability at a grid and at random points of the plane, which is "
        "computed if the store lacks it.",
    ),
]
Certificates = Mapping[str, "Summary | str"]


def verify(
    store: Store,
    sample: Sample = 3,
    plane: Plane = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Check the files and the numbers of a store.

    Examines every required file, decodes every chunk and compares its checksum; then evaluates the equations
    of the stored case at some rows of each branch, curve and table of equilibria. Nothing is changed, except
    by --plane, which adds cases/CASE/survey if it is not there, and cases/CASE/certificate. Exit code 4 if
    something is wrong, or curves do not explain the stability of their plane.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        with console.announce_if_slow("loading kernels (a first run compiles)", SECONDS_BEFORE_ANNOUNCEMENT):
            from pipelines.stages.reports.verify import verify as verify_store

        findings, checked = verify_store(path, sample)
        wrong = [finding for finding in findings if finding.severity == "error"]
        if not json:
            show(findings, checked, console)
        certificates = certify(path, console) if plane and not wrong else {}
        if json:
            console.json_data(as_data(findings, checked, certificates))
        failed = wrong or not all(isinstance(one, str) or one.certified for one in certificates.values())
        raise typer.Exit(ExitCode.STORE if failed else ExitCode.DONE)


def certify(path: Path, console: Console) -> Certificates:
    """The certificate of every case, or why it has none; each is shown as soon as it is there."""
    from pipelines.stages.reports.verify_plane import verify_plane

    found: dict[str, Summary | str] = {}
    for case, certificate in verify_plane(path, ProgressReporter(console)):
        found[case] = certificate
        if not console.json:
            show_certificate(case, certificate, console)
    return found


def show_certificate(case: str, certificate: Summary | str, console: Console) -> None:
    """Show a certificate: a sentence, how many places agree, and those that do not."""
    if isinstance(certificate, str):
        console.message(f"{case}: {certificate}")
        return
    console.data(f"{case}: {certificate.sentence()}")
    rows = [
        (what, tally.agreeing, tally.disagreeing, tally.not_decided, tally.percent)
        for what, tally in (
            ("cells", certificate.cells),
            ("pairs of cells", certificate.pairs),
            ("random points", certificate.points),
        )
    ]
    console.data(table(("", "agree", "disagree", "not decided", "agree [%]"), rows))
    console.data(f"at most {100.0 * certificate.share_at_most:.2g} % of the plane disagree (95 % confidence)")
    if certificate.disagreements:
        names = [name.replace("_", " ") for name in certificate.parameters]
        places = [
            (
                each.along,
                each.across,
                each.found,
                each.expected,
                words(each.kind),
                "yes" if each.random else "",
            )
            for each in certificate.disagreements
        ]
        console.data(table((*names, "unstable", "expected", "curve likely missing", "random"), places))
        console.message(
            "bifurcation_set.certify = true and `agfb run` add branches through these places; so do more "
            "frequencies, speeds or max_rounds"
        )


def show(findings: list[Finding], checked: list[Checked], console: Console) -> None:
    """Show every error on stdout, notes and advice on stderr, and how much was examined."""
    for finding in findings:
        line = f"{finding.path}: {finding.problem}"
        if finding.severity == "error":
            console.data(line)
            console.message(f"  {finding.advice}")
        else:
            console.message(f"note: {line}; {finding.advice}")
    wrong = sum(finding.severity == "error" for finding in findings)
    worst = max((each.residual / each.tolerance for each in checked), default=None)
    evaluated = f"{len(checked)} rows evaluated again" + (
        f", largest residual {worst:.2g} of what is allowed" if worst is not None else ""
    )
    state = f"{wrong} problem{'s' if wrong > 1 else ''}" if wrong else "whole"
    console.data(f"{state}; {evaluated}")


def as_data(findings: list[Finding], checked: list[Checked], certificates: Certificates) -> dict[str, Any]:
    """Findings, residuals and certificates as plain data; a residual that is no number is null."""
    document: dict[str, Any] = finite(
        {
            "findings": [asdict(finding) | {"path": str(finding.path)} for finding in findings],
            "residuals": [asdict(each) | {"holds": each.holds} for each in checked],
            "certificates": {
                case: {"reason": one} if isinstance(one, str) else one.as_dict()
                for case, one in certificates.items()
            },
        }
    )
    return document
