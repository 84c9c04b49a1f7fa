"""The diagnosis of any system of FMUs: names what is wrong at its ports and in its parameters, whatever is inside."""
