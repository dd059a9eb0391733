{{/* Short enough for a pod's name to be a replica's name: 63 characters, no dots. */}}
{{- define "firstfix.name" -}}
{{- $name := .Release.Name -}}
{{- if not (contains "firstfix" $name) }}{{ $name = printf "%s-firstfix" $name }}{{ end -}}
{{- $name | replace "." "-" | trunc 36 | trimSuffix "-" -}}
{{- end }}

{{- define "firstfix.selector" -}}
app.kubernetes.io/name: firstfix
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .component }}
{{- end }}

{{- define "firstfix.labels" -}}
{{ include "firstfix.selector" . }}
app.kubernetes.io/version: {{ .root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .root.Release.Service }}
helm.sh/chart: {{ .root.Chart.Name }}-{{ .root.Chart.Version }}
{{- end }}

{{- define "firstfix.serviceAccount" -}}
{{- .Values.serviceAccount.name | default (.Values.serviceAccount.create | ternary (include "firstfix.name" .) "default") -}}
{{- end }}

{{- define "firstfix.image" -}}
{{- $image := index .root.Values.image .image -}}
{{- with .root.Values.image.registry }}{{ $image = printf "%s/%s" . $image }}{{ end -}}
{{ $image }}:{{ .root.Values.image.tag | default .root.Chart.AppVersion }}
{{- with index .root.Values.image.digests .image }}@{{ . }}{{ end }}
{{- end }}

{{/* Settings as environment variables: words as they are, all else as JSON. */}}
{{- define "firstfix.settings" -}}
{{- range $name, $value := . }}
- name: FIRSTFIX_{{ upper $name }}
  value: {{ kindIs "string" $value | ternary $value (toJson $value) | quote }}
{{- end }}
{{- end }}

{{/* What services and builders have in common. */}}
{{- define "firstfix.environment" -}}
- name: FIRSTFIX_STORE
  value: {{ .root.Values.store.url | quote }}
- name: FIRSTFIX_AUTH
  value: {{ .root.Values.auth | quote }}
- name: FIRSTFIX_HOST
  value: 0.0.0.0
- name: FIRSTFIX_PORT
  value: "8080"
- name: FIRSTFIX_CACHE_DIR
  value: /var/lib/firstfix/cache
- name: FIRSTFIX_WORK_DIR
  value: /var/lib/firstfix/work
{{- with .root.Values.nats.url }}
- name: FIRSTFIX_BUILD_QUEUE
  value: {{ . | quote }}
{{- end }}
{{- if .root.Values.nats.existingSecret }}
- name: FIRSTFIX_NATS_CREDENTIALS
  value: /etc/firstfix/nats/credentials
{{- if .root.Values.nats.caInSecret }}
- name: FIRSTFIX_NATS_CA
  value: /etc/firstfix/nats/ca.pem
{{- end }}
{{- if .root.Values.nats.certificateInSecret }}
- name: FIRSTFIX_NATS_CERTIFICATE
  value: /etc/firstfix/nats/tls.pem
{{- end }}
{{- end }}
{{- include "firstfix.settings" (merge dict .settings .root.Values.settings) }}
{{- with .root.Values.extraEnv }}
{{ toYaml . }}
{{- end }}
{{- end }}

{{- define "firstfix.secrets" -}}
{{- with .Values.store.existingSecret }}
envFrom:
  - secretRef: {name: {{ . }}}
{{- end }}
{{- end }}

{{/* Of those who build: keys of their own where there are such. */}}
{{- define "firstfix.buildSecrets" -}}
{{- with .Values.builder.existingSecret | default .Values.store.existingSecret }}
envFrom:
  - secretRef: {name: {{ . }}}
{{- end }}
{{- end }}

{{- define "firstfix.buildServiceAccount" -}}
{{- if and .Values.serviceAccount.create .Values.builder.serviceAccountAnnotations -}}
{{ include "firstfix.name" . }}-builder
{{- else -}}
{{ include "firstfix.serviceAccount" . }}
{{- end }}
{{- end }}

{{- define "firstfix.podSecurity" -}}
runAsNonRoot: true
runAsUser: 10001
runAsGroup: 10001
fsGroup: 10001
fsGroupChangePolicy: OnRootMismatch
seccompProfile: {type: RuntimeDefault}
{{- end }}

{{- define "firstfix.containerSecurity" -}}
allowPrivilegeEscalation: false
readOnlyRootFilesystem: true
capabilities: {drop: [ALL]}
{{- end }}

{{/* Where pods go. enableServiceLinks: the links of a Service named firstfix would set FIRSTFIX_PORT. */}}
{{- define "firstfix.pod" -}}
serviceAccountName: {{ eq .image "builder" | ternary (include "firstfix.buildServiceAccount" .root) (include "firstfix.serviceAccount" .root) }}
automountServiceAccountToken: false
enableServiceLinks: false
securityContext: {{- include "firstfix.podSecurity" . | nindent 2 }}
{{- with .root.Values.image.pullSecrets }}
imagePullSecrets: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .part.priorityClassName }}
priorityClassName: {{ . }}
{{- end }}
{{- with .part.nodeSelector }}
nodeSelector: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .part.tolerations }}
tolerations: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .part.affinity }}
affinity: {{- toYaml . | nindent 2 }}
{{- end }}
{{- end }}

{{- define "firstfix.natsVolume" -}}
{{- with .Values.nats.existingSecret }}
- name: nats
  secret: {secretName: {{ . }}, defaultMode: 0440}
{{- end }}
{{- end }}

{{- define "firstfix.natsMount" -}}
{{- if .Values.nats.existingSecret }}
- {name: nats, mountPath: /etc/firstfix/nats, readOnly: true}
{{- end }}
{{- end }}

{{- define "firstfix.zenohListens" -}}
{{- if and .Values.zenoh.enabled .Values.zenoh.listen (not .Values.zenoh.existingSecret) }}yes{{ end -}}
{{- end }}
