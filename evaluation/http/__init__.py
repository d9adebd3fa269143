"""InternNav's HTTP form of a navigation model: a client of such models, and a server of ours."""
