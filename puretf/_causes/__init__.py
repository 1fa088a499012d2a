"""Why lookups fail: facts, the rules from facts to causes, and the texts of both."""
