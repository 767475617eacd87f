"""The files of a record by name."""

SAMPLES, DOCUMENT, PAGE, RECIPE = "samples.parquet", "record.json", "record.html", "recipe.toml"
PROOF, PROOF_PAGE = "proof.json", "proof.html"
MANIFEST, SIGNATURE, PUBLIC_KEY = "manifest.json", "manifest.sig", "public_key.pem"
SEALING = frozenset({MANIFEST, SIGNATURE, PUBLIC_KEY})
"""What seals the others."""
