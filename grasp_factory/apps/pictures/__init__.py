"""Pictures of episodes and scenes: sheets, tiles, previews, plots."""
