"""Scenes of exact solids and the sensors that scan them (see docs/design.md)."""

from scan2fea.simulation.lab import Lab, SceneObject, demo_lab
from scan2fea.simulation.scanner import SCENES, LabScan, SimulationOptions, simulate

__all__ = ["SCENES", "Lab", "LabScan", "SceneObject", "SimulationOptions", "demo_lab", "simulate"]
