// Gas and hopper, and what laser and feeder complain about. Laser and powder themselves stand with their trends.
import type { Snapshot } from "../api/types";
import { snapshot } from "../state/cell";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.machine;

interface Row {
  name: string;
  set: number;
  read: number;
}

function rows({ feeder }: Snapshot): Row[] {
  return [
    { name: say.carrier, set: feeder.carrier_gas_setpoint_l_min, read: feeder.carrier_gas_readback_l_min },
    { name: say.shield, set: feeder.shield_gas_setpoint_l_min, read: feeder.shield_gas_readback_l_min },
  ];
}

export function Process() {
  const now = snapshot.value;
  return (
    <section class="panel process">
      <table>
        <thead>
          <tr>
            <th scope="col">
              <h2>{say.gas}</h2>
            </th>
            <th>{say.setpoint}</th>
            <th>{say.readback}</th>
            <th />
          </tr>
        </thead>
        <tbody>
          {now &&
            rows(now).map((row) => (
              <tr key={row.name}>
                <th scope="row">{row.name}</th>
                <td class="number">{fixed(row.set, 1)}</td>
                <td class="number strong">{fixed(row.read, 1)}</td>
                <td class="unit">L/min</td>
              </tr>
            ))}
        </tbody>
      </table>
      {now && <Hopper fraction={now.feeder.hopper_fraction} />}
      {now && <Faults texts={[...now.laser.faults, ...now.laser.interlocks, ...now.feeder.faults]} />}
    </section>
  );
}

function Hopper({ fraction }: { fraction: number }) {
  return (
    <div class="hopper">
      <span>{say.hopper}</span>
      <meter min={0} max={1} low={0.15} value={fraction} aria-label={say.hopper} />
      <b>{fixed(100 * fraction, 0)} %</b>
    </div>
  );
}

function Faults({ texts }: { texts: string[] }) {
  if (texts.length === 0) return null;
  return <p class="device-faults">{texts.join("; ")}</p>;
}
