"""Speed and error measured together: scenes, timing, and cases whose answer is known."""
