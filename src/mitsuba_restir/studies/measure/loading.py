"""From a study's folder to what is measured: the finished runs of a size and its reference."""

from __future__ import annotations

from ..config.study import Size
from ..runs.software import notes_on_software
from ..store.folder import StudyFolder
from ..store.reference import load_reference, notes_on_reference
from .asked import probes_of
from .derived import with_derived
from .excess import sharing_of
from .results import Measured
from .stills import notes_on_stills, rivals_of


def load_size(folder: StudyFolder, size: Size) -> Measured:
    """Load the finished runs of a size, what the probes said, and the reference."""
    study = folder.study
    runs, probes = {}, {}
    for name in study.variants:
        loaded = [folder.load_run(size, name, index) for index in range(study.runs)]
        runs[name] = [run for run in loaded if run is not None]
        for probe in probes_of(study):
            answers = [folder.load_probe(size, name, probe, i) for i in range(study.probe_runs)]
            probes[name, probe] = [answer for answer in answers if answer is not None]
    reference = load_reference(folder, size)
    label = f"{size[0]}x{size[1]}"
    baselines = {name: study.baseline_of(name) for name in study.variants}
    rendered_runs = [run for own in runs.values() for run in own]
    rendered = Measured(
        label,
        runs,
        study.baseline,
        baselines,
        reference,
        study.epsilon,
        study.trim,
        probes,
        settled=study.warmup > 0,
        notes=[
            *notes_on_reference(study, reference),
            *notes_on_software(label, rendered_runs),
            *notes_on_stills(label, runs),
        ],
        sharing=sharing_of(study),
        rivals=rivals_of(study),
    )
    return with_derived(study, rendered)
