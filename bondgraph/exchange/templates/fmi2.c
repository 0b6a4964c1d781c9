/* FMI 2.0 model exchange over model_rhs and model_output. Values by reference: states, their derivatives, inputs,
   parameters, outputs, in the order of the model. */
#include "model.c"
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
#define AT_U (2 * N_X)
#define AT_P (AT_U + N_U)
#define AT_Y (AT_P + N_P)
#define N_V (AT_Y + N_Y)

typedef void *Instance;
typedef unsigned int Reference;
typedef int Status; /* 0: OK, 3: error */
typedef const char *Text;
typedef struct {
  int newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged, valuesOfContinuousStatesChanged,
      nextEventTimeDefined;
  double nextEventTime;
} EventInfo;
typedef struct {
  double t, v[N_V + 1];
  char begun, given[N_X + 1];
} Model;

static void begin(Model *m) {
  m->t = 0.0;
  memcpy(m->v, START, sizeof START);
  m->begun = 0;
  memset(m->given, 0, sizeof m->given);
}

/* until the initialisation ends states that start where parameters say move with them, unless they are given */
static void restart(Model *m) {
#ifdef STARTS
  double x[N_X + 1];
  if (m->begun) return;
  model_start(m->t, m->v, m->v + AT_U, m->v + AT_P, x);
  for (size_t k = 0; k < N_X; k++)
    if (!m->given[k]) m->v[k] = x[k];
#else
  (void)m;
#endif
}

static void update(Model *m) {
  restart(m);
  model_rhs(m->t, m->v, m->v + AT_U, m->v + AT_P, m->v + N_X);
  model_output(m->t, m->v, m->v + AT_U, m->v + AT_P, m->v + AT_Y);
}

API Text fmi2GetTypesPlatform(void) { return "default"; }
API Text fmi2GetVersion(void) { return "2.0"; }
API Instance fmi2Instantiate(Text name, int kind, Text token, Text resources, const void *callbacks, int visible, int log) {
  (void)name, (void)resources, (void)callbacks, (void)visible, (void)log;
  if (kind != 0 || strcmp(token, TOKEN)) return NULL; /* 0: model exchange */
  Model *m = malloc(sizeof(Model));
  if (m) begin(m);
  return m;
}
API void fmi2FreeInstance(Instance m) { free(m); }
API Status fmi2SetDebugLogging(Instance m, int on, size_t n, const Text *names) { (void)m, (void)on, (void)n, (void)names; return 0; }
API Status fmi2SetupExperiment(Instance m, int has_tol, double tol, double start, int has_stop, double stop) {
  (void)has_tol, (void)tol, (void)has_stop, (void)stop;
  ((Model *)m)->t = start;
  return 0;
}
API Status fmi2EnterInitializationMode(Instance m) { (void)m; return 0; }
API Status fmi2ExitInitializationMode(Instance i) {
  Model *m = i;
  restart(m);
  m->begun = 1;
  return 0;
}
API Status fmi2Terminate(Instance m) { (void)m; return 0; }
API Status fmi2Reset(Instance m) { begin(m); return 0; }
API Status fmi2GetReal(Instance i, const Reference *vr, size_t n, double *values) {
  Model *m = i;
  update(m);
  for (size_t k = 0; k < n; k++) {
    if (vr[k] >= N_V) return 3;
    values[k] = m->v[vr[k]];
  }
  return 0;
}
API Status fmi2SetReal(Instance i, const Reference *vr, size_t n, const double *values) {
  Model *m = i;
  for (size_t k = 0; k < n; k++) {
    if (vr[k] >= AT_Y || (vr[k] >= N_X && vr[k] < AT_U)) return 3;
    m->v[vr[k]] = values[k];
    if (vr[k] < N_X) m->given[vr[k]] = 1;
  }
  return 0;
}
#define NO_VALUES(TYPE, NAME)                                                                                          \
  API Status fmi2Get##NAME(Instance m, const Reference *vr, size_t n, TYPE *v) { (void)m, (void)vr, (void)v; return n ? 3 : 0; } \
  API Status fmi2Set##NAME(Instance m, const Reference *vr, size_t n, const TYPE *v) { (void)m, (void)vr, (void)v; return n ? 3 : 0; }
NO_VALUES(int, Integer)
NO_VALUES(int, Boolean)
NO_VALUES(Text, String)
API Status fmi2EnterEventMode(Instance m) { (void)m; return 0; }
API Status fmi2NewDiscreteStates(Instance m, EventInfo *info) { (void)m; memset(info, 0, sizeof *info); return 0; }
API Status fmi2EnterContinuousTimeMode(Instance m) { (void)m; return 0; }
API Status fmi2CompletedIntegratorStep(Instance m, int keep, int *event, int *end) { (void)m, (void)keep; *event = *end = 0; return 0; }
API Status fmi2SetTime(Instance m, double t) { ((Model *)m)->t = t; return 0; }
API Status fmi2SetContinuousStates(Instance m, const double *x, size_t n) {
  if (n != N_X) return 3;
  ((Model *)m)->begun = 1;
  memcpy(((Model *)m)->v, x, n * sizeof *x);
  return 0;
}
API Status fmi2GetDerivatives(Instance i, double *dx, size_t n) {
  Model *m = i;
  if (n != N_X) return 3;
  model_rhs(m->t, m->v, m->v + AT_U, m->v + AT_P, dx);
  return 0;
}
API Status fmi2GetEventIndicators(Instance m, double *z, size_t n) { (void)m, (void)z; return n ? 3 : 0; }
API Status fmi2GetContinuousStates(Instance m, double *x, size_t n) {
  if (n != N_X) return 3;
  restart(m);
  memcpy(x, ((Model *)m)->v, n * sizeof *x);
  return 0;
}
API Status fmi2GetNominalsOfContinuousStates(Instance m, double *x, size_t n) {
  (void)m;
  for (size_t k = 0; k < n; k++) x[k] = 1.0;
  return 0;
}
/* what the description says that this FMU cannot */
API Status fmi2GetFMUstate(Instance m, void **s) { (void)m, (void)s; return 3; }
API Status fmi2SetFMUstate(Instance m, void *s) { (void)m, (void)s; return 3; }
API Status fmi2FreeFMUstate(Instance m, void **s) { (void)m, (void)s; return 3; }
API Status fmi2SerializedFMUstateSize(Instance m, void *s, size_t *n) { (void)m, (void)s, (void)n; return 3; }
API Status fmi2SerializeFMUstate(Instance m, void *s, char *b, size_t n) { (void)m, (void)s, (void)b, (void)n; return 3; }
API Status fmi2DeSerializeFMUstate(Instance m, const char *b, size_t n, void **s) { (void)m, (void)b, (void)n, (void)s; return 3; }
API Status fmi2GetDirectionalDerivative(Instance m, const Reference *z, size_t nz, const Reference *v, size_t nv, const double *dv, double *dz) {
  (void)m, (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz;
  return 3;
}
