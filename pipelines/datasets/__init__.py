"""Stores: the only place that touches files of results."""
