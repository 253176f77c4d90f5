"""`edl-filter serve`: a workbench in the browser, on this computer only, over the same files and commands.

It keeps nothing of its own: missions and results in the served folder are all there is, every piece of work is an
`edl-filter` command in a process of its own, and a page that is loaded again shows what the files say.
"""
