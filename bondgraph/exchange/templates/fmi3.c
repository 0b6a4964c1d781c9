/* FMI 3.0 model exchange over model_rhs and model_output. Values by reference: states, their derivatives, inputs,
   parameters, outputs, in the order of the model; then the time. */
#include "model.c"
#include <stdbool.h>
#include <stdint.h>
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
typedef uint32_t Reference;
typedef int Status; /* 0: OK, 3: error */
typedef const char *Text;
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

API Text fmi3GetVersion(void) { return "3.0"; }
API Status fmi3SetDebugLogging(Instance m, bool on, size_t n, const Text *names) { (void)m, (void)on, (void)n, (void)names; return 0; }
API Instance fmi3InstantiateModelExchange(Text name, Text token, Text resources, bool visible, bool log, void *environment, void *say) {
  (void)name, (void)resources, (void)visible, (void)log, (void)environment, (void)say;
  if (strcmp(token, TOKEN)) return NULL;
  Model *m = malloc(sizeof(Model));
  if (m) begin(m);
  return m;
}
API void fmi3FreeInstance(Instance m) { free(m); }
API Status fmi3EnterInitializationMode(Instance m, bool has_tol, double tol, double start, bool has_stop, double stop) {
  (void)has_tol, (void)tol, (void)has_stop, (void)stop;
  ((Model *)m)->t = start;
  return 0;
}
API Status fmi3ExitInitializationMode(Instance i) {
  Model *m = i;
  restart(m);
  m->begun = 1;
  return 0;
}
API Status fmi3EnterEventMode(Instance m) { (void)m; return 0; }
API Status fmi3Terminate(Instance m) { (void)m; return 0; }
API Status fmi3Reset(Instance m) { begin(m); return 0; }
API Status fmi3GetFloat64(Instance i, const Reference *vr, size_t n, double *values, size_t n_values) {
  Model *m = i;
  if (n != n_values) return 3;
  update(m);
  for (size_t k = 0; k < n; k++) {
    if (vr[k] > N_V) return 3;
    values[k] = vr[k] == N_V ? m->t : m->v[vr[k]];
  }
  return 0;
}
API Status fmi3SetFloat64(Instance i, const Reference *vr, size_t n, const double *values, size_t n_values) {
  Model *m = i;
  if (n != n_values) return 3;
  for (size_t k = 0; k < n; k++) {
    if (vr[k] >= AT_Y || (vr[k] >= N_X && vr[k] < AT_U)) return 3;
    m->v[vr[k]] = values[k];
    if (vr[k] < N_X) m->given[vr[k]] = 1;
  }
  return 0;
}
API Status fmi3UpdateDiscreteStates(Instance m, bool *again, bool *end, bool *nominals, bool *states, bool *timed, double *next) {
  (void)m;
  *again = *end = *nominals = *states = *timed = false;
  *next = 0.0;
  return 0;
}
API Status fmi3EnterContinuousTimeMode(Instance m) { (void)m; return 0; }
API Status fmi3CompletedIntegratorStep(Instance m, bool keep, bool *event, bool *end) { (void)m, (void)keep; *event = *end = false; return 0; }
API Status fmi3SetTime(Instance m, double t) { ((Model *)m)->t = t; return 0; }
API Status fmi3SetContinuousStates(Instance m, const double *x, size_t n) {
  if (n != N_X) return 3;
  ((Model *)m)->begun = 1;
  memcpy(((Model *)m)->v, x, n * sizeof *x);
  return 0;
}
API Status fmi3GetContinuousStateDerivatives(Instance i, double *dx, size_t n) {
  Model *m = i;
  if (n != N_X) return 3;
  model_rhs(m->t, m->v, m->v + AT_U, m->v + AT_P, dx);
  return 0;
}
API Status fmi3GetEventIndicators(Instance m, double *z, size_t n) { (void)m, (void)z; return n ? 3 : 0; }
API Status fmi3GetContinuousStates(Instance m, double *x, size_t n) {
  if (n != N_X) return 3;
  restart(m);
  memcpy(x, ((Model *)m)->v, n * sizeof *x);
  return 0;
}
API Status fmi3GetNominalsOfContinuousStates(Instance m, double *x, size_t n) {
  (void)m;
  for (size_t k = 0; k < n; k++) x[k] = 1.0;
  return 0;
}
API Status fmi3GetNumberOfEventIndicators(Instance m, size_t *n) { (void)m; *n = 0; return 0; }
API Status fmi3GetNumberOfContinuousStates(Instance m, size_t *n) { (void)m; *n = N_X; return 0; }
/* what the description says that this FMU does not have */
#define REFUSED(NAME) API Status NAME(Instance m) { (void)m; return 3; }
REFUSED(fmi3ActivateModelPartition)
REFUSED(fmi3DeserializeFMUState)
REFUSED(fmi3DoStep)
REFUSED(fmi3EnterConfigurationMode)
REFUSED(fmi3EnterStepMode)
REFUSED(fmi3EvaluateDiscreteStates)
REFUSED(fmi3ExitConfigurationMode)
REFUSED(fmi3FreeFMUState)
REFUSED(fmi3GetAdjointDerivative)
REFUSED(fmi3GetBinary)
REFUSED(fmi3GetBoolean)
REFUSED(fmi3GetClock)
REFUSED(fmi3GetDirectionalDerivative)
REFUSED(fmi3GetFMUState)
REFUSED(fmi3GetFloat32)
REFUSED(fmi3GetInt16)
REFUSED(fmi3GetInt32)
REFUSED(fmi3GetInt64)
REFUSED(fmi3GetInt8)
REFUSED(fmi3GetIntervalDecimal)
REFUSED(fmi3GetIntervalFraction)
REFUSED(fmi3GetNumberOfVariableDependencies)
REFUSED(fmi3GetOutputDerivatives)
REFUSED(fmi3GetShiftDecimal)
REFUSED(fmi3GetShiftFraction)
REFUSED(fmi3GetString)
REFUSED(fmi3GetUInt16)
REFUSED(fmi3GetUInt32)
REFUSED(fmi3GetUInt64)
REFUSED(fmi3GetUInt8)
REFUSED(fmi3GetVariableDependencies)
REFUSED(fmi3SerializeFMUState)
REFUSED(fmi3SerializedFMUStateSize)
REFUSED(fmi3SetBinary)
REFUSED(fmi3SetBoolean)
REFUSED(fmi3SetClock)
REFUSED(fmi3SetFMUState)
REFUSED(fmi3SetFloat32)
REFUSED(fmi3SetInt16)
REFUSED(fmi3SetInt32)
REFUSED(fmi3SetInt64)
REFUSED(fmi3SetInt8)
REFUSED(fmi3SetIntervalDecimal)
REFUSED(fmi3SetIntervalFraction)
REFUSED(fmi3SetShiftDecimal)
REFUSED(fmi3SetShiftFraction)
REFUSED(fmi3SetString)
REFUSED(fmi3SetUInt16)
REFUSED(fmi3SetUInt32)
REFUSED(fmi3SetUInt64)
REFUSED(fmi3SetUInt8)
API Instance fmi3InstantiateCoSimulation(Text name) { (void)name; return NULL; }
API Instance fmi3InstantiateScheduledExecution(Text name) { (void)name; return NULL; }
