"use strict";
for (const pre of document.querySelectorAll("pre")) {
  const button = document.createElement("button");
  button.type = "button"; button.className = "copy"; button.textContent = "copy";
  button.addEventListener("click", async () => {
    const text = pre.querySelector("code").textContent;
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "copied";
    } catch {  // no clipboard for a page from disk: the command is selected, to be copied by hand
      getSelection().selectAllChildren(pre.querySelector("code"));
      button.textContent = document.execCommand("copy") ? "copied" : "selected";
    }
    setTimeout(() => { button.textContent = "copy"; }, 2000);
  });
  pre.append(button);
}
const printed = [...document.querySelectorAll("details.printed")];
let closed = [];
addEventListener("beforeprint", () => { closed = printed.filter(d => !d.open); closed.forEach(d => { d.open = true; }); });
addEventListener("afterprint", () => closed.forEach(d => { d.open = false; }));
