"""The operator's page and how it is built."""
