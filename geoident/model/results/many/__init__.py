"""What is found of many cases together: campaigns and projects."""
