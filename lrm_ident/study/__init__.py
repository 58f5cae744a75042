"""Steps of an identification on one model and one data set; each ends as a model file."""
