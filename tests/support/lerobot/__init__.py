"""Random models, paths and hidden arms that the tests of LeRobot's plug-in share."""
