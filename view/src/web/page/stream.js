// The frames of the cell, as server-sent events read by fetch: an EventSource could not send the token that looking needs where
// other machines reach the page.

const RETRY_MS = 700;
// No frame for so long: what is shown is old. The server sends twenty a second.
const SILENT_MS = 1500;

export function headers(token) {
  return token ? { Authorization: `Bearer ${token}` } : {};
}

export async function getJson(place, token) {
  const response = await fetch(place, { headers: headers(token), cache: "no-store" });
  if (!response.ok) throw new Error(await response.text());
  return response.json();
}

// Calls `frame` with each, and `link` with "open", or with "lost" and why.
export async function follow(tokenNow, frame, link) {
  for (;;) {
    const ended = new AbortController();
    try {
      const response = await fetch("frames", { headers: headers(tokenNow()), cache: "no-store", signal: ended.signal });
      if (!response.ok) {
        link(response.status === 401 || response.status === 403 ? "token" : "lost", (await response.text()).trim());
      } else {
        await read(response.body, frame, link, ended);
        link("lost", "the server has closed the page: the cell has ended, or its page");
      }
    } catch (error) {
      link("lost", ended.signal.aborted ? "nothing comes any more" : "the server is not reached");
    }
    await new Promise(done => setTimeout(done, RETRY_MS));
  }
}

async function read(body, frame, link, ended) {
  const reader = body.getReader();
  const decoder = new TextDecoder();
  let rest = "";
  let silent = setTimeout(() => ended.abort(), SILENT_MS);
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      clearTimeout(silent);
      silent = setTimeout(() => ended.abort(), SILENT_MS);
      rest += decoder.decode(value, { stream: true });
      const events = rest.split("\n\n");
      rest = events.pop();
      for (const event of events) {
        const data = event.split("\n").find(line => line.startsWith("data: "));
        if (data) {
          link("open");
          frame(JSON.parse(data.slice(6)));
        }
      }
    }
  } finally {
    clearTimeout(silent);
  }
}
