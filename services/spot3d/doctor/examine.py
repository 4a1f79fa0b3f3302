"""The whole examination: this device, the router, the stages."""

from spot3d.dataflow.alive import others_alive, watch_alive
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d.dataflow.tls import TlsError, probe, why_unreached
from spot3d.doctor.asking import ask_all, collect_health, is_complete, topic_rates
from spot3d.doctor.finding import Finding, checked
from spot3d.doctor.others import TopicRate, look_at, states
from spot3d.doctor.this_device import look_here
from spot3d_schemas import STAGES

_CONNECT_S = 3.0


def examine(link: LinkSettings, seconds: float) -> tuple[list[Finding], list[TopicRate]]:
    """All findings about this device and, where the router answers, about the robot's stages; and what they send."""
    findings = look_here(link)
    try:
        with open_session(link, patience_s=_CONNECT_S) as session, watch_alive(session, link.robot) as alive:
            findings += reached(link)
            # The first second of measuring is also the time for the tokens to come.
            health = collect_health(session, link.robot, seconds)
            there = {stage: stage in alive for stage in STAGES}
            ended = not there["source"] and is_complete(session, link.robot)
            findings += look_at(ask_all(session, link.robot), there, ended)
            if not any(there.values()) and (others := others_alive(session, link.robot, _CONNECT_S)):
                findings.append(Finding("note", "robots", others))
            return findings + states(health), topic_rates(health)
    except TlsError:
        return [*findings, Finding("problem", "router", "not tested without a valid certificate", "see above")], []
    except StoppedError:
        return findings + reached(link, answered=False), []


def reached(link: LinkSettings, answered: bool = True) -> list[Finding]:
    """Findings about the router's endpoints, and the certificates that it shows."""
    where = ", ".join(link.connect)
    if not answered:
        start = "start the router, set [link] connect, and check the network: addresses, firewall, docs/security.md"
        reason, remedy = why_unreached(link, start)
        return [Finding("problem", "router", f"{where}: {reason or 'no answer'}", remedy)]
    findings = [Finding("ok", "router", f"reached at {where}")]
    for endpoint in link.connect:
        if endpoint.startswith("tls/"):
            try:
                shown = probe(endpoint, link)
            except TlsError as error:
                findings.append(Finding("note", "router", str(error), "connected through another of its endpoints"))
                continue
            remedy = "make a new certificate for it: spot3d certificates --out FOLDER NAME --renew"
            findings.append(checked(shown.soon_over, "router's certificate", str(shown), remedy))
    return findings
