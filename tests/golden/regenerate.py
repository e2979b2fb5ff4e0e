"""Freeze the golden values anew: ``python -m tests.golden.regenerate``; review the difference in git."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from tests.golden.values import golden_values

GOLDEN = Path(__file__).with_name("golden.json")


def main() -> None:
    """Write golden.json."""
    with tempfile.TemporaryDirectory() as folder:
        GOLDEN.write_text(json.dumps(golden_values(Path(folder)), indent=1) + "\n")


if __name__ == "__main__":
    main()
