"""The English of indoor routes: words, noun phrases and a small grammar of clauses."""
