"""Looking at a user's own copy of a dataset: everything counted and measured, nothing assumed.

`inspect` is the one call; `records` measures any dataset, `animal3d` what only its files tell,
`stored_fits` compares stored bodies with fits; `result` has the form of the outcome, `answers` and
`text` put it into sentences.
"""
