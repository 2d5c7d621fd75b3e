// What is wider than its place can be reached and scrolled by keyboard.
addEventListener("load", () => {
  for (const place of document.querySelectorAll("pre, .cell_output, .cell_output .output, mjx-container, .table-wrapper, .made"))
    if (place.scrollWidth > place.clientWidth) place.tabIndex = 0;
});
