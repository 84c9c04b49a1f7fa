"""What a comparison is shown beside: a calibration, the observer, the external tracker."""
