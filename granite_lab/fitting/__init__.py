"""From measured and simulated slip to k_92 of each trial and a_θ over trials."""
