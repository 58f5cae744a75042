"""How hard our texts are to read, as counts: words a sentence, passive sentences, rare words."""
