"""What a command does from file to file.

`add_effect` writes a mission with one effect more, `validate` checks a mission as a run does, `dry_run` lists the
files of a command, `run` reconstructs a mission with its effects refitted and writes one result folder,
`diagnose_result` diagnoses a result, `improve_model` repeats diagnosis and refit and keeps a ledger,
`compare_results` tabulates results of one flight. Commands, the Python API and the workbench call these functions;
nothing below imports them.
"""
