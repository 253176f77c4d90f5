"""What a command does from file to file.

`add_effect` writes a mission with one effect more, `validate` checks a mission as a run does, `dry_run` lists the
files of a command, `run` reconstructs a mission with its effects refitted and writes one result folder, `draw_figures`
draws its figures, `diagnose_result` diagnoses a result, `improve_model` repeats diagnosis and refit and keeps a ledger,
`compare_results` tabulates results of one flight. A campaign has `campaign_files` (its folder), `campaign_case` (one
case), `campaign_process` and `campaign_block` (cases in processes of their own, on dask workers), `campaign`
(distribution) and `campaign_report` (store, statistics, figures). Commands, the Python API and the workbench call these
functions; nothing below imports them.
"""
