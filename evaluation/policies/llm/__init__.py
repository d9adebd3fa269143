"""Models behind an OpenAI-compatible server: asked in words, and the policy that does."""
