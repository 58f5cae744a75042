"""Arms with hidden effects, from the independent generator, and what lrm-ident makes of them."""
