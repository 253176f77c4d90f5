"""Progress reports of a command to the program that started it: an environment variable and a line prefix."""

#: If the environment variable is set to ``lines``, a command writes each step to standard error after the prefix.
PROGRESS, PROGRESS_MARK = "EDL_FILTER_PROGRESS", "progress: "
