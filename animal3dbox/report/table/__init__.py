"""A table of all animals of a dataset, a row each, in parts that any engine may write.

From the lowest: `columns` (what a row holds), `label_table` (the rows of some images), `keys` (the
names of rows, and which are missing), `parts` (the files), `plan` (what is still to be made here),
`part_writer` (which gathers rows into parts), `source_file` and `table_gallery` (pictures of some
rows, afterwards).
"""
