"""What is asked of a result: measuring, comparing, diagnosing, predicting."""
