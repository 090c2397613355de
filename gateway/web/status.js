// Renews the page's content every two seconds; says so when the gateway no longer answers.
"use strict";

async function renew() {
  const answer = await fetch("/status", { cache: "no-store" });
  if (!answer.ok) throw new Error(String(answer.status));
  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  document.getElementById("status").replaceWith(fresh.getElementById("status"));
  document.title = fresh.title;
}

function stale() {
  document.getElementById("stale").hidden = false;
}

setInterval(() => renew().catch(stale), 2000);
