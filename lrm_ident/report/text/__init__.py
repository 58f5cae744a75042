"""Words: the one place where values of the rooms below become sentences for a user. Nothing parses them."""
