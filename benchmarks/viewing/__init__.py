"""The viewer and the driving page in headless Chromium."""
