"""Parse the command line; programs that ask for JSON get usage errors as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

from agfb_cli.completion import whole_words
from agfb_cli.console import Console
from agfb_cli.errors import ExitCode, Explanation, explain
from agfb_cli.streams import unfailing_streams
from agfb_cli.surroundings import settle

ASKED_FOR_JSON = "agfb_cli.json"
# UsageError, which typer exports under no name of its own
_REFUSAL: type[Any] = typer.BadParameter.mro()[1]


class Program(TyperGroup):
    """The group of all commands.

    A command line that typer refuses (a missing argument, an unknown option) gets a JSON document on
    stdout when it asks for JSON, besides typer's message on stderr.
    """

    def main(self, *others: Any, **more: Any) -> Any:
        """Run the program, or answer the shell. Text that could not be written is an error at the end."""
        settle()
        with unfailing_streams() as streams:
            try:
                with whole_words():
                    return super().main(*others, **more)
            except SystemExit as stop:
                for stream in streams:
                    stream.flush()
                lost = next((stream.lost for stream in streams if stream.lost is not None), None)
                if lost is None or stop.code not in (ExitCode.DONE, ExitCode.CASES_FAILED):
                    raise
                explanation = explain(lost)
                Console().error(explanation.text)
                raise SystemExit(int(explanation.code)) from None

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words before the command."""
        ctx.meta[ASKED_FOR_JSON] = "--json" in args
        with usage_errors_as_json(ctx.meta[ASKED_FOR_JSON]):
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Parse the command and its words, and run it."""
        with usage_errors_as_json(ctx.meta[ASKED_FOR_JSON]):
            return super().invoke(ctx)


@contextmanager
def usage_errors_as_json(asked: bool) -> Iterator[None]:
    """Write a passing usage error as JSON too, if requested."""
    try:
        yield
    except _REFUSAL as error:
        if asked:
            explanation = Explanation(ExitCode.USAGE, error.format_message())
            Console(json=True).json_data({"error": explanation.as_dict()})
        raise
