"""What the instruct stage must show: lies caught, true texts kept, texts that lead there."""
