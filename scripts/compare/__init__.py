"""Compare stored tables with the records of version 0.2; deleted when all are converted.

Each module here has `NAMES` of records and `tables(name, record) -> {table: rows}`: the record as the tables should
have it, a dictionary for each row. Columns that the table has beyond these are not looked at. `FIGURES` has,
for keys of rows of the results, the label of the same row in the README before.
"""
