// The page "alarms".

export function Alarms() {
  return <section class="alarms" />;
}
