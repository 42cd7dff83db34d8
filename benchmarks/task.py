"""One variant of a study at one size: what a benchmark measures, in a process of its own."""

from __future__ import annotations

from dataclasses import dataclass

from mitsuba_restir.studies.config.study import Size, Study
from mitsuba_restir.studies.runs.probing import KEY, REHEARSAL
from mitsuba_restir.studies.runs.rendering import Renderer, make_renderer, seed_of
from mitsuba_restir.studies.runs.scene import load_scene


@dataclass(frozen=True)
class Task:
    """
    What is measured.

    Fields
    ------
    study : Study
    size : (int, int)
        Width and height in pixels.
    variant : str
    index : int
        Number of the run, whose seeds the frames have.
    """

    study: Study
    size: Size
    variant: str
    index: int

    def renderer(self) -> Renderer:
        """Load the scene and make the variant's renderer."""
        variant = self.study.variants[self.variant]
        return make_renderer(self.study, load_scene(self.study), self.size, self.variant, variant)

    def render(self, renderer: Renderer, first: int, count: int) -> None:
        """Render frames; the measured ones begin with number `warmup`."""
        last = self.warmup + self.study.frames - 1
        for frame in range(first, first + count):
            if renderer.place is not None:
                renderer.place(max(last - frame, 0))
            renderer.frame(self.seed(frame))

    def seed(self, frame: int) -> int:
        """Return the seed of a frame."""
        return seed_of(self.study.seed, KEY, self.index, frame)

    @property
    def pixels(self) -> int:
        """Pixels of a frame."""
        return self.size[0] * self.size[1]

    @property
    def warmup(self) -> int:
        """Frames before the measured ones; the first three compile and record."""
        return max(self.study.warmup, REHEARSAL)
