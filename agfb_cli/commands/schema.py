"""`agfb schema`."""

from __future__ import annotations

from typing import Annotated

import typer

from agfb_cli.console import Console
from agfb_cli.errors import UsageError, explained
from agfb_cli.options import AsJson, Traceback

AsMarkdown = Annotated[bool, typer.Option("--md", help="As Markdown (the default).")]


def schema(markdown: AsMarkdown = False, json: AsJson = False, traceback: Traceback = False) -> None:
    """Print the reference of all configuration keys.

    Meaning, unit, default and bounds of each key, from the models that check a configuration. With --json a
    JSON Schema for editors.
    """
    console = Console(json=json, traceback=traceback)
    with explained(console):
        if markdown and json:
            raise UsageError("--md and --json exclude each other")
        from pipelines.case.reference import json_schema, reference_markdown

        if json:
            console.json_data(json_schema())
        else:
            console.data(reference_markdown().rstrip())
