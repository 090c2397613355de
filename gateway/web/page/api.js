// @ts-check
// Asks the service; an answer that is an error is thrown as its record.
let csrf = "";

// What to do when the service no longer knows who is here.
let gone = () => {};

export const setKey = (key) => {
  csrf = key;
};
export const whenGone = (act) => {
  gone = act;
};

async function ask(method, path, body, headers = {}) {
  const sent = body === undefined ? undefined : JSON.stringify(body);
  const more = method === "GET" ? {} : { "content-type": "application/json", "x-csrf-token": csrf };
  let answer;
  try {
    answer = await fetch(path, { method, body: sent, headers: { ...more, ...headers }, cache: "no-store" });
  } catch {
    throw { code: "OFFLINE", what: "OFFLINE", do: "", fields: {} };
  }
  const told = answer.headers.get("content-type")?.startsWith("application/json")
    ? await answer.json()
    : await answer.text();
  if (told?.code === "E-WEB-LOGIN") gone();
  if (!answer.ok)
    throw typeof told === "object"
      ? { ...told, status: answer.status }
      : { code: "OFFLINE", what: told, do: "", fields: {} };
  return told;
}

export const get = (path) => ask("GET", path);
export const post = (path, body = {}, headers = {}) => ask("POST", path, body, headers);
export const put = (path, body) => ask("PUT", path, body);
export const remove = (path) => ask("DELETE", path);
