"""One picture from independent frames: planned by itself, mixed, rendered to a stated error."""

from .driver import render
from .picture import Progress, Still
from .plan import PLANS, Plan

__all__ = ["PLANS", "Plan", "Progress", "Still", "render"]
