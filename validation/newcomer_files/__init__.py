"""Single changes of healthy files, as newcomers make them: refused, said, without effect, or silently wrong."""
