"""``python -m edl_filter``: the same as ``edl-filter``."""

from edl_filter.cli.commands import main

main()
