"""Scenes of exact solids and the sensors that scan them (see docs/design.md)."""

from scan2fea.simulation.lab import Lab, SceneObject, demo_lab
from scan2fea.simulation.scanner import SCENES, LabOptions, LabScan, simulate, simulate_lab

__all__ = ["SCENES", "Lab", "LabOptions", "LabScan", "SceneObject", "demo_lab", "simulate", "simulate_lab"]
