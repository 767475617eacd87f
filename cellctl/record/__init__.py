"""The record of a job: what was asked for, commanded, read back and done by whom, as one signed set of files.

    gather.py    everything that is known about a job, as one document
    samples.py   the raw samples of its run as Parquet, with units
    page.py      the document as one HTML page without scripts, with its plots
    seal.py      one Ed25519 signature over the hashes of all files of a record
    keeping.py   writes and seals the record of every job whose run has ended
"""
