"""What a fit leaves: free functions, events, lines, slow oscillations, a linear model beside it."""
