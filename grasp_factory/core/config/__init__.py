"""What a dataset is made from: a frozen, validated record and its sections."""
