"""segmentation (see docs/design.md)."""
