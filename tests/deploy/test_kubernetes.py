"""deploy/kubernetes: valid according to Kubernetes' schemas, and set up as the code needs it.

A kustomization here is a list of files, a namespace and names of images, so that the tests render
it without kubectl.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from distributed.cli import dask_scheduler, dask_worker

from foldback.planner.sweeps.case import Limits
from foldback.server.api import health
from foldback.server.doctor import children
from foldback.server.http.security import hosts_of
from foldback.server.settings import Settings
from tests.deploy.files import DEPLOY

VERSION = "1.35"
"""Version of Kubernetes whose schemas are used."""
SERVICE, SWEEP = DEPLOY / "kubernetes", DEPLOY / "kubernetes" / "sweep"
BY_QUEUE = "workers-by-queue.yaml"
"""File that operators add to the list themselves."""
DOCKERFILE = (DEPLOY / "Dockerfile").read_text()
UNITS = {"Mi": 2**20, "Gi": 2**30}
Manifest = dict[str, Any]


def documents(path: Path) -> list[Manifest]:
    return list(yaml.safe_load_all(path.read_text()))


def render(directory: Path, *more: str) -> list[Manifest]:
    """Return the objects of a kustomization."""
    listed = yaml.safe_load((directory / "kustomization.yaml").read_text())
    assert set(listed) == {"apiVersion", "kind", "namespace", "resources", "images"}
    images = {image["name"]: f"{image['newName']}:{image['newTag']}" for image in listed["images"]}
    objects = [
        each for name in (*listed["resources"], *more) for each in documents(directory / name)
    ]
    for each in objects:
        if each["kind"] != "Namespace":
            each["metadata"]["namespace"] = listed["namespace"]
        for container in containers(each):
            container["image"] = images.get(container["image"], container["image"])
    return objects


def containers(manifest: Manifest) -> list[Manifest]:
    return manifest["spec"]["template"]["spec"]["containers"] if is_deployment(manifest) else []


def is_deployment(manifest: Manifest) -> bool:
    return manifest["kind"] == "Deployment"


def size(text: str) -> int:
    return int(text[:-2]) * UNITS[text[-2:]]


OBJECTS = render(SERVICE, BY_QUEUE)
OBJECTS_OF_SWEEP = render(SWEEP)
ALL = [*OBJECTS, *OBJECTS_OF_SWEEP]
NAMED, NAMED_OF_SWEEP = (
    {(each["kind"], each["metadata"]["name"]): each for each in objects}
    for objects in (OBJECTS, OBJECTS_OF_SWEEP)
)
PODS = {
    f"{each['metadata']['namespace']}-{each['metadata']['name']}": each["spec"]["template"]
    for each in ALL
    if is_deployment(each)
}
WEB, WORKER, PROXY = (PODS[f"foldback-{name}"]["spec"] for name in ("web", "worker", "proxy"))
SETTINGS: dict[str, str] = NAMED["ConfigMap", "foldback"]["data"]


def test_manifests_are_valid_and_a_wrong_one_is_found() -> None:
    for manifest in ALL:
        kubernetes_validate.validate(manifest, VERSION, strict=True)
    broken = json.loads(json.dumps(NAMED["Deployment", "web"]))
    broken["spec"]["template"]["spec"]["containers"][0]["readinesProbe"] = {}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, VERSION, strict=True)


@pytest.mark.parametrize("directory", [SERVICE, SWEEP])
def test_kustomization_lists_every_file(directory: Path) -> None:
    listed = yaml.safe_load((directory / "kustomization.yaml").read_text())["resources"]
    files = {path.name for path in directory.glob("*.yaml")} - {"kustomization.yaml", BY_QUEUE}
    assert set(listed) == files and len(listed) == len(files)


def values(node: Any, key: str) -> Iterator[Any]:
    """Yield all values of a key in nested objects and lists."""
    if isinstance(node, dict):
        if key in node:
            yield node[key]
        for child in node.values():
            yield from values(child, key)
    elif isinstance(node, list):
        for child in node:
            yield from values(child, key)


def test_named_objects_exist() -> None:
    made_by_hand = {("Secret", "foldback"), ("ConfigMap", "caddy")}
    for pod in PODS.values():
        for kind, key in (("ConfigMap", "configMapRef"), ("Secret", "secretRef")):
            named = {(kind, each["name"]) for each in values(pod, key)}
            assert named <= {*NAMED, *made_by_hand}
        claims = {("PersistentVolumeClaim", each) for each in values(pod, "claimName")}
        assert claims <= set(NAMED)
        assert {("ConfigMap", each["name"]) for each in values(pod, "configMap")} <= made_by_hand
        for each in values(pod, "configMapKeyRef"):
            assert each["key"] in NAMED["ConfigMap", each["name"]]["data"]
        mounted = {each["name"] for mounts in values(pod, "volumeMounts") for each in mounts}
        assert mounted == {volume["name"] for volume in pod["spec"]["volumes"]}
    # What is made by hand is in the page that tells how.
    page = (DEPLOY.parent / "docs" / "deploy.md").read_text()
    assert "create secret generic foldback " in page
    assert "create configmap caddy --from-file=deploy/Caddyfile" in page
    secrets = set(re.findall(r"--from-literal=([A-Z0-9_]+)=", page))
    assert secrets == {
        *("FOLDBACK_DATABASE_URL", "FOLDBACK_METRICS_TOKEN"),
        *("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"),
    }
    assert not secrets & set(SETTINGS)


def test_selectors_and_ports_meet_pods() -> None:
    for each in ALL:
        namespace, spec = each["metadata"].get("namespace"), each.get("spec", {})
        labels = [
            pod["metadata"]["labels"]
            for name, pod in PODS.items()
            if name.startswith(namespace or "")
        ]
        if each["kind"] in ("Deployment", "PodDisruptionBudget"):
            assert spec["selector"]["matchLabels"] in labels
        if each["kind"] == "Deployment":
            assert spec["template"]["metadata"]["labels"] == spec["selector"]["matchLabels"]
        if each["kind"] == "HorizontalPodAutoscaler":
            target = spec["scaleTargetRef"]
            assert (target["kind"], target["name"]) in NAMED
        if each["kind"] == "Service":
            assert spec["selector"] in labels
            part = f"{namespace}-{spec['selector']['part']}"
            (container,) = PODS[part]["spec"]["containers"]
            ports = {port["name"] for port in container["ports"]}
            assert {port["targetPort"] for port in spec["ports"]} <= ports


@pytest.mark.parametrize("name", PODS)
def test_every_pod_has_the_least_privileges(name: str) -> None:
    pod = PODS[name]["spec"]
    (container,) = pod["containers"]
    context = pod["securityContext"]
    assert context["runAsNonRoot"] and context["seccompProfile"] == {"type": "RuntimeDefault"}
    # Otherwise Kubernetes gives it a token, and variables that look like settings.
    assert pod["automountServiceAccountToken"] is False and pod["enableServiceLinks"] is False
    added = ["NET_BIND_SERVICE"] if name == "foldback-proxy" else []
    assert container["securityContext"]["capabilities"].pop("add", []) == added
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert {"cpu", "memory"} <= set(container["resources"]["limits"])
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(pod)
    assert all(
        set(volume) & {"emptyDir", "configMap", "persistentVolumeClaim"}
        for volume in pod["volumes"]
    )
    if name != "foldback-proxy":
        user = f"USER {context['runAsUser']}:{context['runAsGroup']}\n"
        assert user in DOCKERFILE and context["fsGroup"] == context["runAsGroup"]
    for each in ALL:
        if each["kind"] == "Namespace":
            label = each["metadata"]["labels"]["pod-security.kubernetes.io/enforce"]
            assert label == "restricted"


def test_settings_of_web_processes_and_workers_are_valid_and_equal() -> None:
    assert WEB["containers"][0]["envFrom"] == WORKER["containers"][0]["envFrom"]
    names = {name for name in SETTINGS if name.startswith("FOLDBACK_")}
    environment: dict[str, Any] = {
        name.removeprefix("FOLDBACK_").lower(): SETTINGS[name] for name in names
    }
    settings = Settings(
        **environment, database_url="postgresql://foldback:secret@database/foldback"
    )
    assert settings.workers == 0 and settings.drain_s > 0


def test_probes_and_ports_are_those_of_the_service() -> None:
    (container,) = WEB["containers"]
    (port,) = container["ports"]
    assert f"EXPOSE {port['containerPort']}\n" in DOCKERFILE
    assert f"FOLDBACK_PORT={port['containerPort']} " in DOCKERFILE
    paths = {route.path for route in health.router.routes}
    for kind in ("startup", "readiness", "liveness"):
        probe = container[f"{kind}Probe"]["httpGet"]
        assert probe["path"] in paths and probe["port"] == port["name"]
        (header,) = probe["httpHeaders"]
        assert header["name"] == "Host"
        assert header["value"] in hosts_of("0.0.0.0", [SETTINGS["FOLDBACK_ALLOWED_HOSTS"]])
        # It would take all pods out of the Service if there is no worker.
        assert probe["path"] != "/ready"
    (worker,) = WORKER["containers"]
    assert not {"ports", "startupProbe", "readinessProbe", "livenessProbe"} & set(worker)
    upstreams = {each["name"]: each.get("value") for each in PROXY["containers"][0]["env"]}
    assert upstreams["UPSTREAMS"] == f"dynamic a web {port['containerPort']}"
    # DNS names the pods, and not one address for all.
    assert NAMED["Service", "web"]["spec"]["clusterIP"] == "None"


def test_only_the_proxy_and_prometheus_reach_web_processes() -> None:
    (rule,) = NAMED["NetworkPolicy", "web"]["spec"]["ingress"]
    proxy, prometheus = rule["from"]
    proxy_labels = PODS["foldback-proxy"]["metadata"]["labels"]
    assert proxy == {"podSelector": {"matchLabels": proxy_labels}}
    assert set(prometheus) == {"namespaceSelector"}
    others = NAMED["NetworkPolicy", "foldback"]["spec"]
    assert "Ingress" in others["policyTypes"] and "ingress" not in others


def test_only_pods_of_its_namespace_reach_dask() -> None:
    policy = NAMED_OF_SWEEP["NetworkPolicy", "dask"]["spec"]
    assert policy["podSelector"] == {} and "Ingress" in policy["policyTypes"]
    assert policy["ingress"] == [{"from": [{"podSelector": {}}]}]


def test_stopping_pods_have_time_and_folds_go_back() -> None:
    drain_s = int(SETTINGS["FOLDBACK_DRAIN_S"])
    assert WORKER["terminationGracePeriodSeconds"] >= drain_s + 15
    command, pause_s = WEB["containers"][0]["lifecycle"]["preStop"]["exec"]["command"]
    assert command == "sleep"
    assert WEB["terminationGracePeriodSeconds"] >= int(pause_s) + 20
    # The order of an update (docs/deploy.md) needs both.
    assert NAMED["Deployment", "worker"]["spec"]["strategy"] == {"type": "Recreate"}
    assert NAMED["Deployment", "web"]["spec"]["strategy"]["rollingUpdate"]["maxUnavailable"] == 0


def test_memory_and_disk_suffice() -> None:
    child = int(SETTINGS["FOLDBACK_CHILD_MEMORY_BYTES"])
    defaults = Settings.model_fields
    disk = int(SETTINGS["FOLDBACK_CACHE_BYTES"]) + defaults["previews_bytes"].default
    for pod in (WEB, WORKER):
        (container,) = pod["containers"]
        assert size(container["resources"]["limits"]["memory"]) >= child + 2**29
        mounts = {each["mountPath"]: each["name"] for each in container["volumeMounts"]}
        assert set(mounts) == {
            *json.loads(re.findall(r"^VOLUME (.*)$", DOCKERFILE, re.M)[0]),
            "/tmp",
        }
        limits = {each["name"]: size(each["emptyDir"]["sizeLimit"]) for each in pod["volumes"]}
        assert limits[mounts["/data"]] >= disk
        assert sum(limits.values()) <= size(container["resources"]["limits"]["ephemeral-storage"])


def test_metric_for_the_number_of_workers_exists() -> None:
    target = documents(SERVICE / BY_QUEUE)[0]["spec"]["metrics"][0]["external"]["metric"]["name"]
    page = (DEPLOY.parent / "docs" / "operations.md").read_text()
    assert f"`{target}`" in page


@pytest.mark.processes
def test_sandbox_works_with_the_privileges_of_a_pod() -> None:
    drop = ["--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    done = subprocess.run(
        [
            "setpriv",
            "--no-new-privs",
            *drop,
            sys.executable,
            "-c",
            children._CONFINE,
            "/etc/passwd",
        ],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(done.stdout) == []


def test_image_of_sweeps_is_that_of_the_service_with_the_extra() -> None:
    text = (DEPLOY / "sweep.Dockerfile").read_text()
    assert re.findall(r"^FROM (.*)$", text, re.M) == ["foldback:local"]
    user = re.findall(r"^USER (.*)$", text, re.M)[-1]
    assert user in re.findall(r"^USER (.*)$", DOCKERFILE, re.M)
    project = DEPLOY.parent / "pyproject.toml"
    program = re.findall(r'^RUN python3 -c "(.*)" >', text, re.M)[0]
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            program.replace("/tmp/pyproject.toml", str(project)),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    extras = tomllib.loads(project.read_text())["project"]["optional-dependencies"]
    assert done.stdout.splitlines() == extras["sweep"]


@pytest.mark.parametrize("name", ["scheduler", "worker"])
def test_dask_accepts_the_arguments_of_its_pods(name: str) -> None:
    (container,) = PODS[f"foldback-sweep-{name}"]["spec"]["containers"]
    program, *arguments = container["args"]
    command = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}[program]
    options = command.make_context(program, list(arguments)).params
    assert options["dashboard"] is False
    if name == "worker":
        service = NAMED_OF_SWEEP["Service", "scheduler"]["spec"]
        assert options["scheduler"] == f"tcp://scheduler:{service['ports'][0]['port']}"
        assert options["nthreads"] == 1
    else:
        assert container["ports"][0]["containerPort"] == int(options["port"])


def test_memory_of_a_worker_holds_a_fold_of_a_sweep() -> None:
    (container,) = PODS["foldback-sweep-worker"]["spec"]["containers"]
    own = size(next(each for each in container["args"] if "memory" in each).split("=")[1][:-1])
    assert size(container["resources"]["limits"]["memory"]) >= Limits().memory_bytes + own
