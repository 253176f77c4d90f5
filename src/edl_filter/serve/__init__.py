"""`edl-filter serve`: a workbench in the browser, on this computer only, which uses the same files and commands.

In: a folder with missions and results, and requests of the page. Out: JSON for the page, and `edl-filter` commands that
run in processes of their own. The server stores no state: all missions and results are files in the served folder, and
a page that is loaded again shows their current content.

Read in this order: `server` (socket and life of the server), `app` (routes), `library` (missions and results in the
folder), `overview` (the reconstruction in a result), `plans` (commands of an action), `jobs` (their execution),
`safety` (which requests and paths are accepted); ``static/`` is the page.
"""
