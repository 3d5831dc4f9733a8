"""Values as bytes: annotations packed for workers, the label cache's files, and fingerprints.

`codec` turns values into bytes, `packed` keeps many of them in a few tensors, `segments` appends
them to files, `fingerprint` names contents, `json_files` reads JSON with errors that name the file.
"""
