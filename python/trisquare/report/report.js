"use strict";
for (const slider of document.querySelectorAll("input[data-split]")) {
  const move = () => slider.parentElement.style.setProperty("--split", `${slider.value}%`);
  slider.addEventListener("input", move);
  // A browser that comes back to the page may have kept the slider where it was.
  move();
}
