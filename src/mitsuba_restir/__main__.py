"""``python -m mitsuba_restir`` is the same as ``mitsuba-restir``."""

import sys

from .cli import main

sys.exit(main())
