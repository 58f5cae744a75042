"""Proofs: results that commands write as JSON into docs/proofs, and the pages of the documentation made from them."""
