const lrmTerms = {
 "as deployed": "The error of the model that goes to the arm. Effects of the measurement session and of the tracker are left out there, because the arm cannot know them.",
 "black-box model": "A model that predicts the remaining error from the pose and knows no cause: a Gaussian process on the residuals. It shows how much of the error is systematic.",
 "candidate cause": "An effect that would explain part of the error. The data do not yet show that it is the cause.",
 "empirical term": "A term that improves the prediction although its cause is not identified, such as a spline over a joint's angle.",
 "held-out": "The error at poses that the fit has not seen. The data are split into ten parts, and each part is predicted by a fit to the other nine.",
 "held out": "The error at poses that the fit has not seen. The data are split into ten parts, and each part is predicted by a fit to the other nine.",
 "identified cause": "An effect that the data show to be there: it predicts unseen poses better, no rival does as well, and what it leaves behind is small.",
 "indistinguishable cause": "Two effects that make the same error at these poses. Other poses may distinguish them: `lrm-ident design --separate` chooses such poses.",
 "measurement noise": "The error that the instrument makes by itself. No model can predict better.",
 "Moran's I": "The spatial autocorrelation of the residuals: 0 where errors of neighbouring poses have nothing in common, 1 where they are the same.",
 "RMS": "Root mean square: the typical size of an error, in which large errors count more than in the mean.",
 "turn of joint": "The error as the angle by which one joint alone would have to turn to make it."
};
