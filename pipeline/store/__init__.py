"""Run folders in an object store (S3 and whatever else fsspec reaches)."""
