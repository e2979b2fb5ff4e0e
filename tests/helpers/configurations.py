"""The configurations that come with agfb."""

from __future__ import annotations

from pathlib import Path

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
MODELS = CONFIGS / "models"
"""What `agfb import` reads; no configurations."""
FILES = sorted(path for path in CONFIGS.rglob("*.toml") if path.parent != MODELS)
