"""Run `agfb` as `python -m agfb_cli`, for machines where the script is not on the PATH."""

from __future__ import annotations

from agfb_cli.main import app

if __name__ == "__main__":
    app(prog_name="agfb")
