// A link to a heading within a tab shows that tab: browsers alone scroll to what is hidden, and show nothing.
function showTabOfTarget() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const block = target?.closest(".tabbed-block");
  if (!block) return;
  const tab = [...block.parentElement.children].indexOf(block);
  block.closest(".tabbed-set").querySelectorAll(":scope > input")[tab].click();
  target.scrollIntoView();
}
addEventListener("hashchange", showTabOfTarget);
addEventListener("load", showTabOfTarget);
