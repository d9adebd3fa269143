"""The exact apartment: plan, walls, furniture."""
