"""Puts this folder on the path, so that the tests of the post-flight layer can share `made_flights`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
