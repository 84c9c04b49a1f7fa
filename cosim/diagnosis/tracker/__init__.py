"""The slew sensor against an external tracker."""
