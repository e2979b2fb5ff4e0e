"""Pictures drawn from stores alone: nothing here computes physics."""

from __future__ import annotations
