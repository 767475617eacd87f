// What people leave at a job: notes in their order, and files.
import { useRef, useState } from "preact/hooks";
import { api } from "../api/base";
import { newKey, post, postForm } from "../api/http";
import type { Job, JobAttachment, JobNote } from "../api/types";
import { told } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { fixed, moment } from "../words/format";
import { useDocument } from "./read";

const say = words.jobs;

export function Notes({ job }: { job: Job }) {
  const path = `/jobs/${job.id}/notes`;
  const [notes, setNotes] = useDocument<{ items: JobNote[] }>(path, job);
  const [text, setText] = useState("");
  const [busy, setBusy] = useState(false);
  const key = useRef(newKey("note")); // asked again after a lost answer it is the same note
  const add = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    try {
      const made = await post<JobNote>(path, { text }, key.current);
      setNotes({ items: [...(notes?.items ?? []).filter(({ seq }) => seq !== made.seq), made] });
      key.current = newKey("note");
      setText("");
    } catch (error) {
      told(error);
    } finally {
      setBusy(false);
    }
  };
  return (
    <section class="panel notes">
      <h2>{say.notes}</h2>
      {notes?.items.length === 0 && <p class="muted">{say.noNotes}</p>}
      <ol class="thread">
        {notes?.items.map((note) => (
          <li key={note.seq}>
            <b>{note.who}</b> <span class="muted">{moment(note.at)}</span>
            <p>{note.text}</p>
          </li>
        ))}
      </ol>
      {isOperator.value && (
        <form class="row" onSubmit={(event) => void add(event)}>
          <label class="grow">
            {say.note}
            <textarea rows={2} maxLength={4000} required value={text} onInput={(event) => setText(event.currentTarget.value)} />
          </label>
          <button type="submit" class="control" disabled={busy || !text.trim()}>
            {say.addNote}
          </button>
        </form>
      )}
    </section>
  );
}

export function Attachments({ job }: { job: Job }) {
  const path = `/jobs/${job.id}/attachments`;
  const [files, setFiles] = useDocument<{ items: JobAttachment[] }>(path, job);
  const [busy, setBusy] = useState(false);
  const attach = async (event: Event) => {
    const input = event.currentTarget as HTMLInputElement;
    const file = input.files?.[0];
    if (!file) return;
    setBusy(true);
    const form = new FormData();
    form.set("file", file);
    try {
      const made = await postForm<JobAttachment>(path, form, newKey("file"));
      setFiles({ items: [...(files?.items ?? []).filter(({ id }) => id !== made.id), made] });
    } catch (error) {
      told(error);
    } finally {
      input.value = "";
      setBusy(false);
    }
  };
  return (
    <section class="panel">
      <h2>{say.attachments}</h2>
      {files?.items.length === 0 && <p class="muted">{say.noAttachments}</p>}
      <ul class="attachments">
        {files?.items.map((one) => (
          <li key={one.id}>
            {one.is_image && <img src={`${api}${path}/${one.id}?show=true`} alt={one.name} loading="lazy" />}
            <a href={`${api}${path}/${one.id}`} download={one.name}>
              {one.name}
            </a>
            <span class="muted">
              {say.kib(fixed(one.bytes / 1024, 1))} · {one.who}, {moment(one.at)}
            </span>
          </li>
        ))}
      </ul>
      {isOperator.value && (
        <label>
          {busy ? say.attaching : say.attach}
          <input type="file" disabled={busy} onChange={(event) => void attach(event)} />
          <span>{say.attachHint}</span>
        </label>
      )}
    </section>
  );
}
