// What the theme leaves out for keyboards and screen readers: landmarks have names that differ, and what
// scrolls sideways can be reached.
const names = new Set();

function mend() {
  document.querySelectorAll("nav:not([data-named])").forEach(nav => {
    const label = document.getElementById(nav.getAttribute("aria-labelledby"));
    const name = (nav.getAttribute("aria-label") || (label && label.textContent) || "Code").trim();
    let unique = name;
    for (let number = 2; names.has(unique); number++) unique = `${name} ${number}`;
    names.add(unique);
    nav.dataset.named = "";
    nav.removeAttribute("aria-labelledby");
    nav.setAttribute("aria-label", unique);
  });
  document.querySelectorAll("pre > code, .md-typeset__scrollwrap").forEach(region => {
    if (region.scrollWidth > region.clientWidth) region.tabIndex = 0;
  });
}

new MutationObserver(mend).observe(document.body, {childList: true, subtree: true});
addEventListener("resize", mend);
addEventListener("load", mend);
mend();
