// Code and tables that are wider than the page scroll, and arrow keys scroll them without a pointer.
function reachable() {
  for (const box of document.querySelectorAll("pre, .table-wrapper, .math-wrapper")) {
    if (box.scrollWidth > box.clientWidth || box.scrollHeight > box.clientHeight) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}
addEventListener("load", () => {
  reachable();
  window.MathJax?.startup?.promise?.then(reachable); // formulas are not as wide before they are set
});
addEventListener("resize", reachable);
addEventListener("toggle", reachable, true);  // code that was folded
