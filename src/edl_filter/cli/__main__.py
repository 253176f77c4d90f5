"""``python -m edl_filter.cli``: the same as ``edl-filter``."""

from edl_filter.cli.commands import main

main()
