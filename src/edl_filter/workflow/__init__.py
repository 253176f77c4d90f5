"""What a command does from file to file.

In: arguments of a command, that is paths of missions and results, and options. Out: files of a result, new missions,
and what the command prints as data. Commands, the Python API and the workbench call these functions; nothing below
imports them.

Read in this order: `add_effect` writes a mission with one effect more, `validate` checks a mission as a run does,
`dry_run` lists the files of a command, `run` reconstructs a mission with its effects refitted and writes one result
folder, `diagnose_result` diagnoses a result, `improve_model` repeats diagnosis and refit and keeps a ledger, with
`improvement_state` an interrupted improvement is resumed, `compare_results` tabulates results of one flight,
`draw_figures` draws the figures of a result. A campaign has `campaign_files` (its folder), `campaign_case` (one case),
`campaign_process` (cases in processes of their own, on dask workers), `campaign` (distribution) and `campaign_report`
(store, statistics, figures).
"""
