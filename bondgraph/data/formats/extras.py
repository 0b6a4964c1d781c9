"""Kinds of files that are read as logs, and what each needs; a module that costs nothing to import."""

#: The extra that each kind of file needs; none for those that numpy and scipy read.
EXTRAS = {
    ".csv": "", ".csv.gz": "", ".parquet": "parquet", ".mat": "matlab", ".mf4": "mdf", ".mdf": "mdf", ".h5": "hdf5",
    ".hdf5": "hdf5", ".xlsx": "excel", ".bag": "ros", ".mcap": "mcap",
}  # fmt: skip
