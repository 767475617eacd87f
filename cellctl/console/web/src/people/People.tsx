// People: the own account for everybody, users and tokens for admins, the audit trail for engineers and admins.
import { signal } from "@preact/signals";
import { closeDialog, openDialog } from "../state/dialog";
import { isAdmin, isEngineer } from "../state/session";
import { words } from "../words";
import { Account } from "./Account";
import { Tokens } from "./Tokens";
import { Trail } from "./Trail";
import { Users } from "./Users";

const say = words.people;
const TABS = { account: Account, users: Users, tokens: Tokens, trail: Trail };
type Tab = keyof typeof TABS;
const tab = signal<Tab>("account");

export function openPeople(): void {
  tab.value = "account";
  openDialog(say.title, People);
}

function People() {
  const shown = (Object.keys(TABS) as Tab[]).filter((name) => name === "account" || isAdmin.value || (name === "trail" && isEngineer.value));
  const now = shown.includes(tab.value) ? tab.value : "account";
  const Body = TABS[now];
  const move = (event: KeyboardEvent) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step) return;
    const next = shown[(shown.indexOf(now) + step + shown.length) % shown.length];
    if (!next) return;
    tab.value = next;
    document.getElementById(`people-${next}`)?.focus();
  };
  return (
    <div class="people">
      <div class="panel-head">
        <h1>{say.title}</h1>
        <button type="button" class="control" onClick={closeDialog}>
          {say.close}
        </button>
      </div>
      <div class="people-tabs" role="tablist" aria-label={say.tabsAria} onKeyDown={move}>
        {shown.map((name) => (
          <button
            type="button"
            role="tab"
            key={name}
            id={`people-${name}`}
            class="control"
            aria-controls="people-body"
            aria-selected={now === name}
            tabIndex={now === name ? 0 : -1}
            onClick={() => (tab.value = name)}
          >
            {say.tabs[name]}
          </button>
        ))}
      </div>
      <div class="people-body" id="people-body" role="tabpanel" aria-labelledby={`people-${now}`} tabIndex={0}>
        <Body />
      </div>
    </div>
  );
}
